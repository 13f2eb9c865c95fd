"""Foot locks: feet that stand stay where they are, and the legs follow.

`foot_shift.py` says where each foot goes. Where a leg is too short for that, the pelvis comes down
a little; hip and knee bend (`two_bone.py`). The foot keeps its shape and its slope; every bone
keeps its length.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.foot_shift import FootLock, foot_shift
from latentmotion.cleanup.legs import Leg, find_legs
from latentmotion.cleanup.smoothing import upper_envelope
from latentmotion.cleanup.two_bone import reach
from latentmotion.skeleton import Skeleton

Joints = Float[np.ndarray, "frames joints 3"]


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
        skeleton: Says what legs and feet are.
        settings: How feet are held.
    """
    legs = find_legs(skeleton)
    feet = [*skeleton.left_foot, *skeleton.right_foot]
    moved = []
    for leg in legs:
        pivots = joints[:, list(leg.pivots)]
        standing = contacts[:, [feet.index(pivot) for pivot in leg.pivots]]
        moved.append(foot_shift(pivots, standing, fps, settings))
    lowered = joints.copy()
    lowered[..., 1] -= _lowering(joints, legs, moved, fps, settings)[:, None]
    across = _across(joints, legs)
    for leg, shift in zip(legs, moved, strict=True):
        _pose(lowered, joints, leg, joints[:, leg.ankle] + shift, across, settings)
    return lowered


def _lowering(
    joints: Joints,
    legs: list[Leg],
    moved: list[Float[np.ndarray, "frames 3"]],
    fps: float,
    settings: FootLock,
) -> Float[np.ndarray, " frames"]:
    """Returns how far the pelvis comes down for all ankles to reach their goals."""
    need = np.zeros(len(joints))
    for leg, shift in zip(legs, moved, strict=True):
        line = joints[:, leg.ankle] + shift - joints[:, leg.hip]
        across = np.linalg.norm(line[:, ::2], axis=-1)
        height = np.sqrt(np.maximum(_longest(joints, leg, settings) ** 2 - across**2, 0))
        need = np.maximum(need, -line[:, 1] - height)
    need = np.clip(need, 0, settings.lower)
    return upper_envelope(need, max(1, round(0.15 * fps)))


def _longest(joints: Joints, leg: Leg, settings: FootLock) -> Float[np.ndarray, " frames"]:
    """Returns how long each leg may be, hip to ankle."""
    hip, knee, ankle = (joints[:, joint] for joint in (leg.hip, leg.knee, leg.ankle))
    whole = np.linalg.norm(knee - hip, axis=-1) + np.linalg.norm(ankle - knee, axis=-1)
    return np.maximum(settings.stretch * whole, np.linalg.norm(ankle - hip, axis=-1))


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
    line, longest = goal - hip, _longest(joints, leg, settings)[:, None]
    length = np.linalg.norm(line, axis=-1, keepdims=True)
    goal = hip + line * np.minimum(1, longest / np.maximum(length, 1e-9))
    foot = joints[:, leg.pivots[-1]] - joints[:, leg.ankle]
    ahead = np.cross(across, hip - ankle) + 0.1 * foot
    moved[:, leg.knee], moved[:, leg.ankle] = reach(hip, knee, ankle, goal, ahead)
    below = list(leg.below)
    moved[:, below] = joints[:, below] + (moved[:, leg.ankle] - joints[:, leg.ankle])[:, None]
