"""Foot locks: feet that stand stay where they are; body and legs follow.

A drift that planted feet have in common is taken by the body, the rest by each leg
(`foot_shift.py`). Where a leg is too short for that, the pelvis comes down a little; hip and knee
bend (`leg_ik.py`). The foot keeps its shape and its slope; every bone keeps its length.

Drift: where feet slide with the body above them, legs alone would have to lean to hold them. A
correction r of the root, smooth in time, takes what it can. With p the path of a foot that stands,
w how surely it does, and means over each contact,

    minimize   Σ w |(p + r) − mean (p + r)|²  +  a Σ |z|²,     r = g ∗ z,   g a Gaussian,

over z by conjugate gradients. The second term keeps the body where it was wherever that costs legs
little: r goes back to nothing as soon as feet allow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.contacts import FootStance, Path, foot_stance
from latentmotion.cleanup.foot_shift import FootLock, foot_shift
from latentmotion.cleanup.leg_ik import Leg, find_legs, keep_knee_direction, reach
from latentmotion.cleanup.smoothing import upper_envelope
from latentmotion.kinematics.skeleton import Skeleton

Joints = Float[np.ndarray, "frames joints 3"]
Lengths = Float[np.ndarray, " frames"]

_SWAY = 0.2
"""Deviation, seconds, of the Gaussian by which the body's own correction is smooth."""

_ROUNDS = 12
"""Steps of the conjugate gradients that find it."""

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
        foot = foot_stance(joints[:, list(leg.pivots)], standing, fps, settings.landing)
        foot = foot.broken_at_jumps(settings.pause(fps))
        feet.append(foot.eased(settings.rest, settings.far))
    root = drift_correction(feet, _SWAY * fps, settings.stay)
    carried = joints + root[:, None]
    shifts = [
        foot_shift(carried[:, list(leg.pivots)], foot.moved(root), fps, settings)
        for leg, foot in zip(legs, feet, strict=True)
    ]
    return keep_knee_direction(_posed(carried, legs, shifts, fps, settings), joints, skeleton)


def _posed(
    joints: Joints, legs: list[Leg], shifts: list[Path], fps: float, settings: FootLock
) -> Joints:
    """Returns the joints with each foot shifted, the pelvis lowered where it must be."""
    moved = joints.copy()
    moved[..., 1] -= _lowering(joints, legs, shifts, fps, settings)[:, None]
    across = np.zeros((len(joints), 3))
    if len(legs) > 1:  # from the right hip to the left
        across = joints[:, legs[0].hip] - joints[:, legs[1].hip]
    for leg, shift in zip(legs, shifts, strict=True):
        hip, drop = moved[:, leg.hip], joints[:, leg.hip] - moved[:, leg.hip]
        knee, ankle = joints[:, leg.knee] - drop, joints[:, leg.ankle] - drop
        line = joints[:, leg.ankle] + shift - hip
        length = np.linalg.norm(line, axis=-1)
        share = _stretched(length, joints, leg, settings) / np.maximum(length, 1e-9)
        foot = joints[:, leg.pivots[-1]] - joints[:, leg.ankle]
        ahead = np.cross(across, hip - ankle) + 0.1 * foot
        goal, below = hip + line * share[:, None], list(leg.below)
        moved[:, leg.knee], moved[:, leg.ankle] = reach(hip, knee, ankle, goal, ahead)
        # The foot keeps its shape and slope.
        moved[:, below] = joints[:, below] + (moved[:, leg.ankle] - joints[:, leg.ankle])[:, None]
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


def drift_correction(feet: Sequence[FootStance], deviation: float, stay: float) -> Path:
    """Returns how far the body is moved in each frame for its planted feet to slide least.

    Args:
        feet: The stance of each foot.
        deviation: Of the Gaussian g, frames.
        stay: a, the weight of staying: the larger, the less the body is moved.
    """
    frames = len(feet[0].path)
    width = min(int(np.ceil(3 * deviation)), frames - 1)
    window = np.exp(-0.5 * (np.arange(-width, width + 1) / deviation) ** 2)
    window = window / window.sum()
    contacts = [(slice(*p), foot.weight[slice(*p), None]) for foot in feet for p in foot.intervals]

    def spread(values: Path) -> Path:
        half = len(window) // 2
        columns = [np.convolve(column, window)[half : half + frames] for column in values.T]
        return np.stack(columns, axis=1)

    def normal(values: Path) -> Path:
        moved, pull = spread(values), np.zeros_like(values)
        for part, weight in contacts:
            pull[part] += _off_center(moved[part], weight)
        return spread(pull) + stay * values

    slides = np.zeros((frames, 3))
    for foot in feet:
        for interval in foot.intervals:
            part = slice(*interval)
            slides[part] += _off_center(foot.path[part], foot.weight[part, None])
    return spread(_conjugate_gradients(normal, -spread(slides)))


def _off_center(path: Path, weight: Float[np.ndarray, "frames 1"]) -> Path:
    """Returns how far a path is from its weighted mean, times the weight."""
    return weight * (path - (weight * path).sum(axis=0) / weight.sum())


def _conjugate_gradients(operator: Callable[[Path], Path], right: Path) -> Path:
    """Solves operator(x) = right, symmetric and positive, all columns at once."""
    found, rest, direction = np.zeros_like(right), right, right
    first = size = float((rest**2).sum())
    for _ in range(_ROUNDS):
        if size <= 1e-6 * first:
            break
        image = operator(direction)
        step = size / float((direction * image).sum())
        found, rest = found + step * direction, rest - step * image
        before, size = size, float((rest**2).sum())
        direction = rest + size / before * direction
    return found
