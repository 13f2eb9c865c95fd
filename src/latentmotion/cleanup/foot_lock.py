"""Foot locks: standing feet stay in place; body and legs follow.

The body takes a drift that planted feet have in common, each leg the rest. Where a leg is too short
for that, the pelvis comes down a little; hip and knee bend (`leg_ik.py`). The foot keeps its shape
and its slope; every bone keeps its length.

Drift. Where feet slide together with the body above them, legs alone would have to lean to hold
them. A correction r of the root, smooth in time, takes as much as it can. With p the path of a
standing foot, w the confidence that it stands, and means over each contact,

    minimize   Σ w |(p + r) − mean (p + r)|²  +  a Σ |z|²,     r = g ∗ z,   g a Gaussian,

over z by conjugate gradients. The second term keeps the body where it was wherever that costs the
legs little: r returns to zero as soon as the feet allow.

Shift of each foot.

1. While a foot stands, it is shifted from its path to the position where it is slowest; a contact
   in which it slides far is broken by a small step.
2. Between contacts the shift is a cubic that leaves one and meets the next with the velocity at
   which the foot's own has gone to zero, so that no foot starts or stops with a jerk.
3. Joints below the floor are lifted onto it. Feet that take a small step pass above it; feet that
   swing fast are as high above it as 19 of 20 are in motion capture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.contacts import FootStance, Path, foot_stance, ramp
from latentmotion.cleanup.leg_ik import Leg, find_legs, keep_knee_direction, reach
from latentmotion.cleanup.smoothing import upper_envelope
from latentmotion.kinematics.skeleton import Skeleton

Joints = Float[np.ndarray, "frames joints 3"]
Lengths = Float[np.ndarray, " frames"]

_SWAY = 0.2
"""Standard deviation, seconds, of the Gaussian g of the body's correction."""

_ROUNDS = 12
"""Iterations of the conjugate gradients that find it."""

_LOWERED = 0.98
"""Share of its full length to which a leg may stretch before the pelvis comes down."""


@dataclass(frozen=True)
class FootLock:
    """Settings of foot locks."""

    rest: tuple[float, float] = (0.045, 0.085)
    """Meters per second: a foot slower than the first for a quarter of its contact rests and is
    left alone; one faster than the second slides and is held."""
    far: tuple[float, float] = (0.02, 0.035)
    """Meters, root mean square: a resting foot that moves farther than this is held, too."""
    landing: float = 0.7
    """Meters per second above which a foot that lands or takes off is not held."""
    blend: float = 0.4
    """Seconds in which a foot returns to its own path where no other contact follows soon."""
    slip: float = 0.15
    """Meters of sliding up to which a foot is held; beyond, it takes a small step."""
    step: float = 0.03
    """Height, meters, of that small step."""
    clearance: float = 0.02
    """Least height, meters, of foot joints that swing faster than 0.8 m/s."""
    stay: float = 1.0
    """a, the weight of keeping the body in place instead of moving it to hold planted feet."""
    lower: float = 0.03
    """Meters that the pelvis may come down where a leg is too short."""
    stretch: tuple[float, float] = (0.92, 0.995)
    """Shares of its full length: a leg stretches softly beyond the first and never beyond the
    second, unless it already did."""

    def pause(self, fps: float) -> int:
        """Returns how many frames a step takes."""
        return max(1, round(0.75 * self.blend * fps))


def lock_feet(
    joints: Joints,
    contacts: Bool[np.ndarray, "frames feet"],
    fps: float,
    skeleton: Skeleton,
    settings: FootLock,
) -> Joints:
    """Returns the joints with feet that do not slide while they have contact.

    Args:
        joints: Positions, meters, the floor at height 0.
        contacts: For each joint of the left foot, then of the right, whether it stands.
        fps: Frames per second.
        skeleton: The skeleton; it has at least one leg.
        settings: Settings of foot locks.
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
        # The nearer a leg is to straight, the less of the wanted length it gets: a knee that stops
        # at once where the leg is straight would snap.
        whole, before = _leg_lengths(joints, leg)
        easy = np.maximum(settings.stretch[0] * whole, before)
        room = np.maximum(settings.stretch[1] * whole - easy, 0.1 * np.maximum(whole - easy, 0))
        room = room + 1e-6
        over = np.maximum(0, length - easy)
        stretched = np.minimum(length, easy) + room * (1 - np.exp(-over / room))
        share = stretched / np.maximum(length, 1e-9)
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
        whole, before = _leg_lengths(joints, leg)
        longest = np.maximum(_LOWERED * whole, before)
        height = np.sqrt(np.maximum(longest**2 - across**2, 0))
        need = np.maximum(need, -line[:, 1] - height)
    need = np.clip(need, 0, settings.lower)
    return upper_envelope(need, max(1, round(0.15 * fps)))


def _leg_lengths(joints: Joints, leg: Leg) -> tuple[Lengths, Lengths]:
    """Returns the length of a straight leg, and the distance from hip to ankle."""
    hip, knee, ankle = (joints[:, joint] for joint in (leg.hip, leg.knee, leg.ankle))
    straight = np.linalg.norm(knee - hip, axis=-1) + np.linalg.norm(ankle - knee, axis=-1)
    return straight, np.linalg.norm(ankle - hip, axis=-1)


def drift_correction(feet: Sequence[FootStance], deviation: float, stay: float) -> Path:
    """Returns the correction of the root in each frame for which planted feet slide least.

    Args:
        feet: The stance of each foot.
        deviation: Standard deviation of the Gaussian g, frames.
        stay: a: the larger, the less the body moves.
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
        for inside, weight in contacts:
            pull[inside] += _off_center(moved[inside], weight)
        return spread(pull) + stay * values

    slides = np.zeros((frames, 3))
    for foot in feet:
        for interval in foot.intervals:
            inside = slice(*interval)
            slides[inside] += _off_center(foot.path[inside], foot.weight[inside, None])
    right = -spread(slides)
    solution, rest, direction = np.zeros_like(right), right, right
    first = size = float((rest**2).sum())
    for _ in range(_ROUNDS):  # conjugate gradients, all columns at once
        if size <= 1e-6 * first:
            break
        image = normal(direction)
        step = size / float((direction * image).sum())
        solution, rest = solution + step * direction, rest - step * image
        before, size = size, float((rest**2).sum())
        direction = rest + size / before * direction
    return spread(solution)


def _off_center(path: Path, weight: Float[np.ndarray, "frames 1"]) -> Path:
    """Returns how far a path is from its weighted mean, times the weight."""
    return weight * (path - (weight * path).sum(axis=0) / weight.sum())


def foot_shift(
    pivots: Float[np.ndarray, "frames pivots 3"], foot: FootStance, fps: float, settings: FootLock
) -> Path:
    """Returns the vector from where a foot is to where it should be.

    Args:
        pivots: Its joints that touch the floor.
        foot: Its stance.
        fps: Frames per second.
        settings: Settings of foot locks.
    """
    foot = foot.broken_at_slips(settings.slip, settings.pause(fps))
    shift = np.zeros_like(foot.path)
    for interval in foot.intervals:
        inside = slice(*interval)
        shift[inside] = foot.center(interval) - foot.path[inside]
    before: list[int | None] = [None, *(end - 1 for _, end in foot.intervals)]
    after: list[int | None] = [*(start for start, _ in foot.intervals), None]
    for last, first in zip(before, after, strict=True):
        whole = last is None and first is None
        if not whole and (len(shift) - 1 if last is None else last) != first:
            _bridge(shift, (last, first), max(1, round(settings.blend * fps)))
    # The foot is raised so that it is not below the floor, and steps over it.
    height = np.maximum(
        settings.clearance * ramp(_speed(pivots + shift[:, None], fps), 0.4, 0.8),
        settings.step * ramp(_speed(shift[:, None], fps), 0.2, 0.6),
    )
    frames, distance = np.arange(len(shift)), np.full(len(shift), np.inf)
    for start, end in foot.intervals:
        outside = np.maximum(start - frames, frames - (end - 1))
        distance = np.minimum(distance, np.maximum(0, outside))
    height = height * ramp(distance, 0.0, 0.15 * fps)[:, None]
    need = np.maximum(0, height - pivots[..., 1]).max(axis=1)
    up = upper_envelope(need, max(1, round(0.1 * fps)))
    return shift + up[:, None] * (0, 1, 0)


@dataclass(frozen=True)
class _Knot:
    frame: int
    value: Float[np.ndarray, " 3"]
    slope: Float[np.ndarray, " 3"]


def _bridge(shift: Path, gap: tuple[int | None, int | None], blend: int) -> None:
    """Fills a gap in place: from one contact's shift to the next's, or to zero in between."""
    (left, right), none = gap, np.zeros(3)
    knots = []
    if left is not None:
        leaving = _Knot(left, shift[left], shift[left] - shift[left - 1])
        knots += [leaving, _Knot(left + blend, none, none)]
    if right is not None:
        meeting = _Knot(right, shift[right], shift[right + 1] - shift[right])
        knots += [_Knot(right - blend, none, none), meeting]
    if left is not None and right is not None and right - left < 2 * blend:
        knots = [knots[0], knots[-1]]
    for a, b in pairwise(knots):  # the cubic between two knots, themselves left out (Hermite)
        frames = np.arange(max(a.frame + 1, 0), min(b.frame, len(shift)))
        length = max(b.frame - a.frame, 1)
        u = ((frames - a.frame) / length)[:, None]
        rise = length * (u * (1 - u) ** 2 * a.slope - u**2 * (1 - u) * b.slope)
        ease = u**2 * (3 - 2 * u)
        shift[frames] = (1 - ease) * a.value + ease * b.value + rise


def _speed(
    points: Float[np.ndarray, "frames pivots 3"], fps: float
) -> Float[np.ndarray, "frames pivots"]:
    if len(points) < 2:
        return np.zeros(points.shape[:2])
    return np.linalg.norm(np.gradient(points, axis=0)[..., ::2], axis=-1) * fps
