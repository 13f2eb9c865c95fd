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

from latentmotion.arrays import Lengths, cross, dot, length, real_frames
from latentmotion.cleanup.contacts import FootStances, Paths, Phase, foot_stances, ramp, velocity
from latentmotion.cleanup.leg_ik import Leg, find_legs, keep_knee_direction, reach
from latentmotion.cleanup.smoothing import upper_envelope
from latentmotion.kinematics.skeleton import BatchedJoints, Skeleton

Shifts = Float[np.ndarray, "frames motions legs 3"]

# Standard deviation, seconds, of the Gaussian g of the body's correction.
_SWAY = 0.2

# Iterations of the conjugate gradients that find it.
_ROUNDS = 12

# Share of its full length to which a leg may stretch before the pelvis comes down.
_LOWERED = 0.98


@dataclass(frozen=True)
class FootLock:
    """Settings of foot locks."""

    # Meters per second: a foot slower than the first for a quarter of its contact rests and is left
    # alone; one faster than the second slides and is held.
    rest: tuple[float, float] = (0.045, 0.085)
    # Meters, root mean square: a resting foot that moves farther than this is held, too.
    far: tuple[float, float] = (0.02, 0.035)
    # Meters per second above which a foot that lands or takes off is not held.
    landing: float = 0.7
    # Seconds in which a foot returns to its own path where no other contact follows soon.
    blend: float = 0.4
    # Meters of sliding up to which a foot is held; beyond, it takes a small step.
    slip: float = 0.15
    step: float = 0.03  # Height, meters, of that small step.
    clearance: float = 0.02  # Least height, meters, of foot joints that swing faster than 0.8 m/s.
    # a, the weight of keeping the body in place instead of moving it to hold planted feet.
    stay: float = 1.0
    lower: float = 0.03  # Meters that the pelvis may come down where a leg is too short.
    # Shares of its full length: a leg stretches softly beyond the first and never beyond the
    # second, unless it already did.
    stretch: tuple[float, float] = (0.92, 0.995)


def lock_feet(
    joints: BatchedJoints,
    contacts: Bool[np.ndarray, "frames *batch feet"],
    fps: float,
    skeleton: Skeleton,
    settings: FootLock,
    lengths: Lengths = None,
) -> BatchedJoints:
    """Returns the joints with feet that do not slide while they have contact.

    Args:
        joints: Positions, meters, the floor at height 0.
        contacts: For each joint of the left foot, then of the right, whether it stands.
        fps: Frames per second.
        skeleton: The skeleton; it has at least one leg.
        settings: Settings of foot locks.
        lengths: Frames of each motion of a padded batch.
    """
    legs, order = find_legs(skeleton), [*skeleton.left_foot, *skeleton.right_foot]
    # A foot with fewer joints than the other has its first one twice, which changes nothing.
    most = max(len(leg.pivots) for leg in legs)
    pivots = [[leg.pivots[0]] * (most - len(leg.pivots)) + [*leg.pivots] for leg in legs]
    columns = [[order.index(pivot) for pivot in foot] for foot in pivots]
    every = joints.reshape(len(joints), -1, len(skeleton), 3)
    shape = (len(joints), every.shape[1] * len(legs), most)
    standing = contacts.reshape(*every.shape[:2], -1)[..., columns].reshape(shape)
    touching = every[:, :, pivots].reshape(*shape, 3)
    of_feet = None if lengths is None else np.repeat(lengths, len(legs))
    path, stances = foot_stances(touching, standing, fps, settings.landing, of_feet)
    pause = max(1, round(0.75 * settings.blend * fps))  # frames that a step takes
    stances = stances.broken_at_jumps(path, pause)
    path = stances.eased(path, settings.rest, settings.far)
    root = drift_correction(path, stances, len(legs), _SWAY * fps, settings.stay, lengths)
    carried, drift = every + root[:, :, None], np.repeat(root, len(legs), axis=1)
    touching, path = touching + drift[:, :, None], path + drift
    stances = stances.broken_at_slips(path, settings.slip, pause)
    shifts = foot_shifts(touching, path, stances, fps, settings, of_feet)
    shifts = shifts.reshape(*every.shape[:2], len(legs), 3)
    moved = _posed(carried, legs, shifts, fps, settings, lengths).reshape(joints.shape)
    return keep_knee_direction(moved, joints, skeleton)


def _posed(
    joints: BatchedJoints,
    legs: Sequence[Leg],
    shifts: Shifts,
    fps: float,
    settings: FootLock,
    lengths: Lengths,
) -> BatchedJoints:
    """Returns the joints with each foot shifted, the pelvis lowered where it must be."""
    hips, knees, ankles, toes = np.array(
        [(leg.hip, leg.knee, leg.ankle, leg.pivots[-1]) for leg in legs]
    ).T
    hip, knee, ankle = (joints[:, :, chain] for chain in (hips, knees, ankles))
    whole, before = length(knee - hip) + length(ankle - knee), length(ankle - hip)
    moved, goals = joints.copy(), ankle + shifts
    # The pelvis comes down for all ankles to reach their goals.
    line = goals - hip
    longest = np.maximum(_LOWERED * whole, before)
    height = np.sqrt(np.maximum(longest**2 - dot(line[..., ::2], line[..., ::2]), 0))
    need = np.clip((-line[..., 1] - height).max(axis=-1), 0, settings.lower)
    down = upper_envelope(need, max(1, round(0.15 * fps)), lengths)[..., None]
    moved[..., 1] -= down
    for joint in (hip, knee, ankle):
        joint[..., 1] -= down
    line = goals - hip
    distance = length(line)
    # The nearer a leg is to straight, the less of that distance it gets: a knee that stops
    # at once where the leg is straight would snap.
    easy = np.maximum(settings.stretch[0] * whole, before)
    room = np.maximum(settings.stretch[1] * whole - easy, 0.1 * np.maximum(whole - easy, 0))
    room = room + 1e-6
    over = np.maximum(0, distance - easy)
    stretched = np.minimum(distance, easy) + room * (1 - np.exp(-over / room))
    share = stretched / np.maximum(distance, 1e-9)
    ahead = 0.1 * (moved[:, :, toes] - ankle)
    if len(legs) > 1:  # across from the right hip to the left
        ahead = ahead + cross(hip[:, :, :1] - hip[:, :, 1:], hip - ankle)
    posed = reach(hip, knee, ankle, hip + line * share[..., None], ahead)
    moved[:, :, knees], moved[:, :, ankles] = posed
    carry = posed[1] - ankle
    for n, leg in enumerate(legs):  # the foot keeps its shape and slope
        moved[:, :, list(leg.below)] += carry[:, :, n, None]
    return moved


def drift_correction(
    path: Paths,
    stances: FootStances,
    legs: int,
    deviation: float,
    stay: float,
    lengths: Lengths = None,
) -> Float[np.ndarray, "frames motions 3"]:
    """Returns the correction of roots in each frame for which planted feet slide least.

    Args:
        path: How feet slide, those of a motion one after the other.
        stances: When they stand.
        legs: Feet of one motion.
        deviation: Standard deviation of the Gaussian g, frames.
        stay: a: the larger, the less the body moves.
        lengths: Frames of each motion of a padded batch.
    """
    frames, motions = len(path), path.shape[1] // legs
    correction = np.zeros((frames, motions, 3))
    if not stances.phases:
        return correction
    width = min(int(np.ceil(3 * deviation)), frames - 1)
    window = np.exp(-0.5 * (np.arange(-width, width + 1) / deviation) ** 2)
    window = window / window.sum()
    frame, motion = stances.at[0], stances.at[1] // legs
    place, real = motion * frames + frame, real_frames(lengths, frames).T

    # Values are along x and z, of motion after motion, frame after frame.
    def spread(values: np.ndarray) -> np.ndarray:
        apart = np.zeros((2, motions, frames + width))
        apart[..., :frames] = values
        spread = np.convolve(apart.ravel(), window, "same").reshape(apart.shape)
        return spread[..., :frames] * real

    def pulls(standing: Float[np.ndarray, "standing 2"]) -> np.ndarray:
        off_center = stances.weight[:, None] * (standing - stances.mean(standing))
        total = [np.bincount(place, column, frames * motions) for column in off_center.T]
        return spread(np.reshape(total, (2, motions, frames)))

    def product(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, "motions 1"]:
        return np.einsum("cmf,cmf->m", a, b)[:, None]

    rest = direction = -pulls(path[stances.at][:, ::2])
    solution = np.zeros_like(rest)
    first = size = product(rest, rest)
    for _ in range(_ROUNDS):  # conjugate gradients, both directions of a motion at once
        far = size > 1e-6 * first
        if not far.any():
            break
        image = pulls(spread(direction)[:, motion, frame].T) + stay * direction
        step = np.where(far, size / np.maximum(product(direction, image), 1e-300), 0)
        solution, rest = solution + step * direction, rest - step * image
        before, size = size, product(rest, rest)
        direction = rest + size / np.maximum(before, 1e-300) * direction
    correction[..., ::2] = spread(solution).T
    return correction


def foot_shifts(
    pivots: Float[np.ndarray, "frames feet pivots 3"],
    path: Paths,
    stances: FootStances,
    fps: float,
    settings: FootLock,
    lengths: Lengths = None,
) -> Paths:
    """Returns the vectors from where feet are to where they should be.

    Args:
        pivots: Their joints that touch the floor.
        path: How they slide.
        stances: When they stand.
        fps: Frames per second.
        settings: Settings of foot locks.
        lengths: Frames of each foot's motion, where there is padding.
    """
    shift, standing = np.zeros(path.shape), path[stances.at]
    shift[stances.at] = stances.mean(standing) - standing
    _bridge(shift, stances.phases, max(1, round(settings.blend * fps)), lengths)
    # The foot is raised so that it is not below the floor, and steps over it.
    points = np.concatenate([shift[:, :, None], pivots + shift[:, :, None]], axis=2)
    speed = length(velocity(points, fps, lengths)[..., ::2])
    height = np.maximum(
        settings.step * ramp(speed[..., :1], 0.2, 0.6),
        settings.clearance * ramp(speed[..., 1:], 0.4, 0.8),
    )
    frames = np.arange(len(shift), dtype=float)[:, None]
    last, following = (np.full(shift.shape[:2], fill) for fill in (-np.inf, np.inf))
    last[stances.at] = following[stances.at] = stances.at[0]
    last = np.maximum.accumulate(last, axis=0)
    following = np.minimum.accumulate(following[::-1], axis=0)[::-1]
    distance = np.minimum(frames - last, following - frames)
    height = height * ramp(distance, 0.0, 0.15 * fps)[..., None]
    need = np.maximum(0, height - pivots[..., 1]).max(axis=-1)
    shift[..., 1] += upper_envelope(need, max(1, round(0.1 * fps)), lengths)
    return shift


def _bridge(shift: Paths, phases: Sequence[Phase], blend: int, lengths: Lengths) -> None:
    """Fills gaps in place: from one contact's shift to the next's, or to zero in between.

    Each curve is a cubic between two knots, themselves left out (Hermite). A knot is the end of a
    contact, whose shift and slope it has, or a frame in which both are zero.
    """
    curves = []  # foot, first knot, whether it is of a contact, last knot, whether it is
    for before, after in pairwise([None, *phases, None]):
        left, right = (before or (0, 0, 0))[2] - 1, (after or (0, 0, 0))[1]
        if before and after and before[0] == after[0] and right - left < 2 * blend:
            curves.append((before[0], left, True, right, True))
            continue
        if before:
            curves.append((before[0], left, True, left + blend, False))
        if after:
            curves.append((after[0], right - blend, False, right, True))
    foot, start, from_contact, end, to_contact = np.array(curves, int).reshape(-1, 5).T
    last = len(shift) - 1 if lengths is None else lengths[foot] - 1
    # Where a contact ends and just before, where one begins and just after.
    knots = np.array([start, start - 1, end, end + 1]).clip(0, last)
    real = np.array([from_contact, from_contact, to_contact, to_contact])
    a, before_a, b, after_b = real[..., None] * shift[knots, foot]
    first = np.maximum(start + 1, 0)
    count = np.maximum(np.minimum(end, last + 1) - first, 0)
    curve = np.repeat(np.arange(len(curves)), count)
    frame = np.arange(len(curve)) + (first - np.cumsum(count) + count)[curve]
    frames = np.maximum(end - start, 1)[:, None]
    u = (frame - start[curve])[:, None] / frames[curve]
    leaving, meeting = (frames * (a - before_a))[curve], (frames * (after_b - b))[curve]
    rise = u * (1 - u) ** 2 * leaving - u**2 * (1 - u) * meeting
    ease = u**2 * (3 - 2 * u)
    shift[frame, foot[curve]] = (1 - ease) * a[curve] + ease * b[curve] + rise
