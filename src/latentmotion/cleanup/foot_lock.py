"""Foot locks: feet that stand stay where they are; body and legs follow.

A drift that planted feet have in common is taken by the body (`drift.py`), the rest by each leg
(`foot_shift.py`). Where a leg is too short for that, the pelvis comes down a little; hip and knee
bend (`two_bone.py`). The foot keeps its shape and its slope; every bone keeps its length.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.bearing import Path, bearing
from latentmotion.cleanup.drift import drift_correction
from latentmotion.cleanup.foot_shift import FootLock, foot_shift
from latentmotion.cleanup.knees import keep_ahead
from latentmotion.cleanup.leg_ik import reach
from latentmotion.cleanup.legs import Leg, find_legs
from latentmotion.cleanup.smoothing import upper_envelope
from latentmotion.kinematics.skeleton import Skeleton

Joints = Float[np.ndarray, "frames joints 3"]
Lengths = Float[np.ndarray, " frames"]

_SWAY = 0.2
"""Deviation, seconds, of the Gaussian by which the body's own correction is smooth."""

_LOWERED = 0.98
"""Share of its length that a leg may have before the pelvis comes down."""


def lock_feet(
    joints: Joints,
    contacts: Bool[np.ndarray, "frames feet"],
    fps: float,
    skeleton: Skeleton,
    settings: FootLock,
) -> Joints:
    """Returns the joints with feet that stand still while they have contact.

    Args:
        joints: Positions, meters, the floor at height 0.
        contacts: For each joint of the left foot, then of the right, whether it stands.
        fps: Frames per second.
        skeleton: Says what legs and feet are; it has at least one leg.
        settings: How feet are held.
    """
    legs, order = find_legs(skeleton), [*skeleton.left_foot, *skeleton.right_foot]
    feet = []
    for leg in legs:
        standing = contacts[:, [order.index(pivot) for pivot in leg.pivots]]
        foot = bearing(joints[:, list(leg.pivots)], standing, fps, settings.landing)
        foot = foot.broken_at_jumps(settings.pause(fps))
        feet.append(foot.eased(settings.rest, settings.far))
    root = drift_correction(feet, _SWAY * fps, settings.stay)
    carried = joints + root[:, None]
    shifts = [
        foot_shift(carried[:, list(leg.pivots)], foot.moved(root), fps, settings)
        for leg, foot in zip(legs, feet, strict=True)
    ]
    return keep_ahead(_posed(carried, legs, shifts, fps, settings), joints, skeleton)


def _posed(
    joints: Joints, legs: list[Leg], shifts: list[Path], fps: float, settings: FootLock
) -> Joints:
    """Returns the joints with each foot shifted, the pelvis lowered where it must be."""
    moved = joints.copy()
    moved[..., 1] -= _lowering(joints, legs, shifts, fps, settings)[:, None]
    across = _across(joints, legs)
    for leg, shift in zip(legs, shifts, strict=True):
        _pose(moved, joints, leg, joints[:, leg.ankle] + shift, across, settings)
    return moved


def _lowering(
    joints: Joints, legs: list[Leg], shifts: list[Path], fps: float, settings: FootLock
) -> Lengths:
    """Returns how far the pelvis comes down for all ankles to reach their goals."""
    need = np.zeros(len(joints))
    for leg, shift in zip(legs, shifts, strict=True):
        line = joints[:, leg.ankle] + shift - joints[:, leg.hip]
        across = np.linalg.norm(line[:, ::2], axis=-1)
        longest = np.maximum(_LOWERED * _whole(joints, leg), _length(joints, leg))
        height = np.sqrt(np.maximum(longest**2 - across**2, 0))
        need = np.maximum(need, -line[:, 1] - height)
    need = np.clip(need, 0, settings.lower)
    return upper_envelope(need, max(1, round(0.15 * fps)))


def _across(joints: Joints, legs: list[Leg]) -> Float[np.ndarray, "frames 3"]:
    """Returns the direction from the right hip to the left; nothing where there is one leg."""
    if len(legs) < 2:
        return np.zeros((len(joints), 3))
    return joints[:, legs[0].hip] - joints[:, legs[1].hip]


def _pose(
    moved: Joints,
    joints: Joints,
    leg: Leg,
    goal: Float[np.ndarray, "frames 3"],
    across: Float[np.ndarray, "frames 3"],
    settings: FootLock,
) -> None:
    """Puts a leg under its hip with the ankle at its goal, the foot as it was, in place."""
    hip, drop = moved[:, leg.hip], joints[:, leg.hip] - moved[:, leg.hip]
    knee, ankle = joints[:, leg.knee] - drop, joints[:, leg.ankle] - drop
    line = goal - hip
    length = np.linalg.norm(line, axis=-1)
    share = _stretched(length, joints, leg, settings) / np.maximum(length, 1e-9)
    foot = joints[:, leg.pivots[-1]] - joints[:, leg.ankle]
    ahead = np.cross(across, hip - ankle) + 0.1 * foot
    moved[:, leg.knee], moved[:, leg.ankle] = reach(
        hip, knee, ankle, hip + line * share[:, None], ahead
    )
    below = list(leg.below)
    moved[:, below] = joints[:, below] + (moved[:, leg.ankle] - joints[:, leg.ankle])[:, None]


def _stretched(wanted: Lengths, joints: Joints, leg: Leg, settings: FootLock) -> Lengths:
    """Returns how long a leg gets: the less of what is wanted, the nearer it is to straight.

    A knee that stops at once where the leg is straight would snap.
    """
    whole, (soft, hard) = _whole(joints, leg), settings.stretch
    easy = np.maximum(soft * whole, _length(joints, leg))
    room = np.maximum(hard * whole - easy, 0.1 * np.maximum(whole - easy, 0)) + 1e-6
    over = np.maximum(0, wanted - easy)
    return np.minimum(wanted, easy) + room * (1 - np.exp(-over / room))


def _whole(joints: Joints, leg: Leg) -> Lengths:
    hip, knee, ankle = (joints[:, joint] for joint in (leg.hip, leg.knee, leg.ankle))
    return np.linalg.norm(knee - hip, axis=-1) + np.linalg.norm(ankle - knee, axis=-1)


def _length(joints: Joints, leg: Leg) -> Lengths:
    return np.linalg.norm(joints[:, leg.ankle] - joints[:, leg.hip], axis=-1)
