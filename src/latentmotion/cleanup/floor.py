"""Floor: standing feet are at height 0, and no body sinks in or hovers.

1. The whole motion is shifted by one number if the feet of an upright body stand far from 0.
2. Where the lowest joint hovers for longer than any jump lasts, the body is lowered. A body that
   lies (pelvis low) may hover a little, for its flesh; one that does not and is as high as a step
   of stairs stands on something, if it began lower, or began much higher and ends on the floor,
   and its sentence, where it has one, names something to stand on.
3. Where the body is below the floor, it is lifted; feet are lifted by their own legs, hands by
   their arms. A jump, a ladder, a flight of stairs are left as they are.

Seats: who sits on something stays at its height until getting up.

Nothing in a generated motion carries a sitter, so the pelvis sinks. While thighs are level, shanks
and trunk upright, and the feet ahead of a pelvis that hardly moves, the pelvis is held at the
height at which the body came to rest; it comes and goes from there by a quintic. Feet stay where
they are, legs bend; feet that hover a little are set down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import (
    Lengths,
    cross,
    dot,
    held,
    length,
    quantile,
    real_frames,
    running_maximum,
    unit,
)
from latentmotion.cleanup.contacts import ramp, velocity
from latentmotion.cleanup.leg_ik import find_legs, reach
from latentmotion.cleanup.smoothing import gaussian, quintic, upper_envelope
from latentmotion.kinematics.skeleton import BatchedJoints, Joints, Skeleton
from latentmotion.measure.signals import spans

_ARM = ("shoulder", "elbow", "wrist")


@dataclass(frozen=True)
class Floor:
    """Settings of the floor's height."""

    # Meters that standing feet may be off the floor, as they are in motion capture.
    tolerance: float = 0.03
    # Heights of the pelvis, meters, below which a body lies and above which it does not.
    lying: tuple[float, float] = (0.25, 0.4)
    # Meters that the lowest joint of a lying body may be above the floor, for its flesh.
    hover: float = 0.1
    # Meters that the lowest joint of another body may be above the floor: below the first it
    # hovers, above the second it stands on something.
    step: tuple[float, float] = (0.12, 0.17)
    # Meters from which one who begins above the floor and ends on it comes down from something.
    above: float = 0.5
    longest_jump: float = 1.2  # Seconds that a body may be in the air.
    sink: float = 0.04  # Meters that feet may be below the floor for legs to lift them alone.


def align_floor(
    joints: BatchedJoints,
    fps: float,
    skeleton: Skeleton,
    settings: Floor = Floor(),
    on_floor: Bool[np.ndarray, "*batch"] = np.array(False),  # noqa: B008
    lengths: Lengths = None,
) -> BatchedJoints:
    """Returns the joints, whole poses moved up or down so that they stand or lie on height 0.

    Args:
        joints: Positions, meters.
        fps: Frames per second.
        skeleton: Names feet and hands.
        settings: Settings of the floor's height.
        on_floor: Of which motions it is known that they stand on nothing above the floor.
        lengths: Frames of each motion of a padded batch.
    """
    feet = [*skeleton.left_foot, *skeleton.right_foot]
    hands = [joint for arm in find_arms(skeleton) for joint in arm[2:]]
    body = [joint for joint in range(len(skeleton)) if joint not in (*feet, *hands)]
    moved = held(joints, lengths)
    low, high = settings.lying
    if feet:  # 1. one number, the height under standing feet
        lowest = moved[..., feet, 1].min(axis=-1)
        stands = moved[..., 0, 1] - lowest > high
        stands &= np.abs(velocity(lowest, fps, lengths)) < 0.1
        if lengths is not None:
            stands &= real_frames(lengths, len(moved))
        columns = zip(
            lowest.reshape(len(lowest), -1).T, stands.reshape(len(lowest), -1).T, strict=True
        )
        under = [heights[still] for heights, still in columns]
        level = np.array([quantile(heights, 0.1) if len(heights) else 0.0 for heights in under])
        level = level.reshape(lowest.shape[1:])
        shift = np.sign(level) * np.maximum(0, np.abs(level) - settings.tolerance)
        moved[..., 1] -= shift[..., None]
    # 2. A body comes down by what it hovers for longer than a jump lasts.
    lies = np.maximum(0, np.minimum(1, (high - moved[..., 0, 1]) / (high - low)))
    reach, last = min(round(settings.longest_jump * fps / 2), len(moved) - 1), len(moved) - 1
    around = np.clip(np.arange(-reach, last + reach + 1), 0, last)
    heights = moved[..., 1].min(axis=-1)
    base = -running_maximum(-heights[around], 2 * reach + 1)
    climbed = np.logical_or.accumulate(heights < settings.step[0], axis=0)
    climbed |= (heights[0] > settings.above) & (heights[-1] < settings.step[0])
    stands_on = climbed * ramp(base, *settings.step)
    hover = lies * np.maximum(0, base - settings.hover)
    hover += (1 - lies) * (1 - stands_on) * np.maximum(0, base - settings.tolerance)
    # One who hardly moves is not jumping, however short it is.
    stands_on = climbed * ramp(heights, *settings.step)
    hangs = (1 - lies) * (1 - stands_on) * np.maximum(0, heights - settings.tolerance)
    root = velocity(moved[..., 0, :], fps, lengths)
    calm = (length(root) < _CALM) & (np.abs(root[..., 1]) < _LEVEL_SPEED)
    still = _lasting(calm, max(1, round(_HANGING * fps)), lengths)
    hover = np.maximum(hover, np.where(still, hangs, 0))
    # Nor is one who is up for longer, however high; a pelvis may rise and fall meanwhile.
    aloft = on_floor * (1 - lies) * np.maximum(0, heights - settings.tolerance)
    hover = np.maximum(hover, np.where(_lasting(aloft > 0, 2 * reach + 1, lengths), aloft, 0))
    if hover.any():
        # What is smooth lacks the tops of what is not; a second pass has most of them.
        down = gaussian(hover, 0.2 * fps, lengths)
        down += gaussian(np.maximum(0, hover - down), 0.2 * fps, lengths)
        moved[..., 1] -= np.maximum(0, down)[..., None]
    # 3. What is below the floor is lifted.
    below = np.maximum(0, -moved[..., body, 1].min(axis=-1))
    if feet:
        below = np.maximum(below, -settings.sink - moved[..., feet, 1].min(axis=-1))
    moved[..., 1] += upper_envelope(below, max(1, round(0.2 * fps)), lengths)[..., None]
    return lift_hands(moved, fps, skeleton, lengths)


# Meters per second of a root that neither travels, nor rises or falls; seconds that it lasts at
# least, which is longer than the top of a jump.
_CALM, _LEVEL_SPEED, _HANGING = 0.3, 0.1, 0.25


def _lasting(
    flags: Bool[np.ndarray, frames * batch], width: int, lengths: Lengths
) -> Bool[np.ndarray, frames * batch]:
    """Returns what is true for some frames in a row at least."""
    if len(flags) < width:
        return np.zeros(flags.shape, bool)
    if lengths is not None:
        flags = flags & real_frames(lengths, len(flags))
    whole = ~running_maximum(~flags, width)
    padding = np.zeros((width - 1, *flags.shape[1:]), bool)
    return running_maximum(np.concatenate([padding, whole, padding]), width)


@lru_cache(maxsize=16)
def find_arms(skeleton: Skeleton) -> tuple[tuple[int, int, int], ...]:
    """Returns shoulder, elbow and wrist of both arms, as far as the skeleton has them."""
    index = {name: joint for joint, name in enumerate(skeleton.names)}
    sides = [[f"{side}_{name}" for name in _ARM] for side in ("left", "right")]
    arms = [[index[name] for name in side] for side in sides if set(side) <= set(index)]
    return tuple((shoulder, elbow, wrist) for shoulder, elbow, wrist in arms)


def lift_hands(
    joints: BatchedJoints, fps: float, skeleton: Skeleton, lengths: Lengths = None
) -> BatchedJoints:
    """Returns the joints with no wrist below the floor at height 0."""
    arms = np.array(find_arms(skeleton), int).reshape(-1, 3)
    shoulder, elbow, wrist = (joints[..., arms[:, n], :] for n in range(3))
    below = np.maximum(0, -wrist[..., 1])
    moved = joints.copy()
    if not below.any():
        return moved
    up = upper_envelope(below, max(1, round(0.1 * fps)), lengths)[..., None]
    between = shoulder.mean(axis=-2, keepdims=True)
    outward = elbow - (shoulder + wrist) / 2 + 0.1 * (shoulder - between)
    new = reach(shoulder, elbow, wrist, wrist + up * (0, 1, 0), outward)
    for n, old, position in zip((1, 2), (elbow, wrist), new, strict=True):
        moved[..., arms[:, n], :] = np.where(up > 0, position, old)
    return moved


# Meters of the lowest joint, a foot, above which a body may be in the air; meters per second
# squared; share of a fall's depth that the pelvis moves at least in a flight.
_LOW_FOOT, _GRAVITY, _FLIGHT = 0.04, 9.81, 0.5


def land_walkers(joints: Joints, fps: float, skeleton: Skeleton) -> Joints:
    """Returns the joints with a body lowered that is in the air and does not fall.

    A body that nothing carries falls: its pelvis is on a parabola, half a meter above the line
    between both ends after 0.6 s. One that was raised for a goal is not.

    Args:
        joints: Positions, meters, the floor at height 0.
        fps: Frames per second.
        skeleton: Names the feet.
    """
    feet, settings = [*skeleton.left_foot, *skeleton.right_foot], Floor()
    lowest, pelvis = joints[..., 1].min(axis=1), joints[:, 0, 1]
    if not feet:
        return joints
    upright = pelvis > settings.lying[1]
    aloft = (joints[:, feet, 1].min(axis=1) == lowest) & (lowest > _LOW_FOOT) & upright
    hovers = np.zeros(len(joints))
    for start, end in spans(aloft):
        first, last = max(start - 1, 0), min(end, len(joints) - 1)
        line = np.linspace(pelvis[first], pelvis[last], last - first + 1)
        fall = _GRAVITY * ((last - first) / fps) ** 2 / 8
        if (pelvis[first : last + 1] - line).max() < _FLIGHT * fall:
            hovers[start:end] = lowest[start:end] - settings.tolerance
    hovers *= 1 - ramp(lowest, *settings.step) * (lowest[0] > settings.tolerance)
    down = np.clip(gaussian(hovers, 0.1 * fps), 0, None)
    return joints - np.minimum(down, np.maximum(0, lowest))[:, None, None] * (0, 1, 0)


def lift_feet(
    joints: Joints,
    fps: float,
    skeleton: Skeleton,
    floor: float,
    share: Float[np.ndarray, " frames"],
) -> Joints:
    """Returns the joints with no foot below a height, legs bent for it.

    Args:
        joints: Positions, meters.
        fps: Frames per second.
        skeleton: Says what legs are.
        floor: The height, meters.
        share: How much of it is done in each frame.
    """
    legs, moved = find_legs(skeleton), joints.copy()
    across = joints[:, legs[0].hip] - joints[:, legs[-1].hip] if legs else joints[:, 0]
    for leg in legs:
        foot = [leg.ankle, *leg.below]
        below = np.maximum(0, floor - joints[:, foot, 1].min(axis=1))
        up = (share * upper_envelope(below, max(1, round(0.1 * fps))))[:, None]
        hip, knee, ankle = (joints[:, joint] for joint in (leg.hip, leg.knee, leg.ankle))
        ahead = cross(across, hip - ankle)
        bent, tip = reach(hip, knee, ankle, ankle + up * (0, 1, 0), ahead)
        moved[:, leg.knee] = np.where(up > 0, bent, knee)
        moved[:, foot] += np.where(up > 0, tip - ankle, 0)[:, None]
    return moved


# Height of a seated pelvis, in lengths of a leg, where sitting begins, and while it lasts; so are
# all limits.
_LOW = (0.35, 0.78), (0.25, 0.85)

# Greatest rise of a thigh, least rise of shank and trunk, as shares of their lengths; a trunk
# that leans forward to get up still sits.
_LEVEL, _UPRIGHT = (0.6, 0.85), (0.75, 0.5)

# Least distance of the feet ahead of the pelvis, in lengths of a leg; a squat has less.
_AHEAD = 0.25, 0.1

# Meters per second up to which the pelvis of a sitter moves down or up, and up.
_SLOW = 0.25, 0.4

# Seconds that somebody sits at least, and from whose heights that of the seat is taken.
_SHORTEST, _SETTLED = 0.6, 0.5

# Seconds in which the pelvis goes to the height of the seat and leaves it.
_BLEND = 0.5

# Height of the lowest joint of a sole on the floor, and heights between which a sitter's foot stops
# to hover and is raised on purpose, meters.
_SOLE, _RAISED = 0.015, (0.1, 0.15)


def hold_seats(
    joints: BatchedJoints, fps: float, skeleton: Skeleton, lengths: Lengths = None
) -> BatchedJoints:
    """Returns the joints with sitters that do not sink.

    Args:
        joints: Positions, meters, the floor at height 0.
        fps: Frames per second.
        skeleton: Says what legs are.
        lengths: Frames of each motion of a padded batch.
    """
    legs = find_legs(skeleton)
    if len(legs) < 2 or len(joints) < _SHORTEST * fps:
        return joints
    (begins, lasts), height = _seated(joints, fps, skeleton, lengths), joints[:, :, 0, 1]
    if not begins.any():
        return joints
    shift, frames = np.zeros(height.shape), np.arange(len(joints), dtype=float)
    sits = np.zeros(height.shape)
    for motion in range(joints.shape[1]):
        for first, end in spans(lasts[:, motion]):
            start = first + int(begins[first:end, motion].argmax())
            if begins[first:end, motion].sum() < _SHORTEST * fps:
                continue
            settled = height[start : start + max(1, round(_SETTLED * fps)), motion]
            gap = np.median(settled) - height[:, motion]
            gap = np.where(frames < start, gap[start], np.where(frames >= end, gap[end - 1], gap))
            away = np.maximum(start - frames, frames - (end - 1)) / (_BLEND * fps)
            ease = quintic(np.clip(1 - np.maximum(away, 0), 0, 1))
            shift[:, motion] += gap * ease
            sits[:, motion] = np.maximum(sits[:, motion], ease)
    up, moved = np.array([0.0, 1.0, 0.0]) * shift[..., None], joints.copy()
    held = {joint for leg in legs for joint in (leg.ankle, *leg.below)}
    body = [joint for joint in range(len(skeleton)) if joint not in held]
    moved[:, :, body] += up[:, :, None]
    across = moved[:, :, legs[0].hip] - moved[:, :, legs[1].hip]
    for leg in legs:
        hip, ankle = moved[:, :, leg.hip], joints[:, :, leg.ankle]
        ahead = cross(across, hip - ankle)
        sole = joints[:, :, list(leg.pivots), 1].min(axis=-1)
        hover = np.maximum(0, sole - _SOLE) * (1 - ramp(sole, *_RAISED))
        down = np.array([0.0, 1.0, 0.0]) * (sits * gaussian(hover, 0.1 * fps, lengths))[..., None]
        knee, tip = reach(hip, moved[:, :, leg.knee], ankle + up, ankle - down, ahead)
        moved[:, :, leg.knee], moved[:, :, leg.ankle] = knee, tip
        moved[:, :, list(leg.below)] += (tip - ankle)[:, :, None]
    return np.where(sits[..., None, None] == 0, joints, moved)


def _seated(
    joints: BatchedJoints, fps: float, skeleton: Skeleton, lengths: Lengths
) -> tuple[Bool[np.ndarray, "frames motions"], Bool[np.ndarray, "frames motions"]]:
    """Returns whether somebody surely sits on something higher than the floor, and may still."""
    legs, pelvis = find_legs(skeleton), joints[:, :, 0]
    hips, knees, ankles = (
        joints[:, :, [getattr(leg, name) for leg in legs]] for name in ("hip", "knee", "ankle")
    )
    thighs, shanks = hips - knees, knees - ankles
    thigh, shank = length(thighs), length(shanks)
    leg = np.maximum((thigh + shank).mean(axis=-1), 1e-6)
    rise = (thighs[..., 1] / np.maximum(thigh, 1e-6)).max(axis=-1)
    upright = (shanks[..., 1] / np.maximum(shank, 1e-6)).min(axis=-1)
    trunk = np.ones(upright.shape)
    if "neck" in skeleton.names:
        trunk = unit(joints[:, :, skeleton.names.index("neck")] - pelvis)[..., 1]
    across = unit((hips[:, :, 0] - hips[:, :, 1]) * (1, 0, 1))
    ahead = cross(across, np.array([0.0, 1.0, 0.0]))
    feet = dot(ankles.mean(axis=2) - pelvis, ahead) / leg
    height = pelvis[..., 1] / leg
    climb = velocity(pelvis[..., 1], fps, lengths)
    begins, lasts = (
        (height > _LOW[n][0])
        & (height < _LOW[n][1])
        & (rise < _LEVEL[n])
        & (upright > _UPRIGHT[n])
        & (feet > _AHEAD[n])
        & (climb < _SLOW[n])
        for n in (0, 1)
    )
    still = (np.abs(climb) < _SLOW[0]) & (trunk > _UPRIGHT[0])
    lasts &= real_frames(lengths, len(joints))
    return begins & lasts & still, lasts
