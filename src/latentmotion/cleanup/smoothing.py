"""Smoothing: removes jitter without delay and keeps both end points.

    y = (2g − g∗g) ∗ x,   g a Gaussian

2g − g∗g keeps straight lines, parabolas and cubics unchanged, and so the peak of a kick; it falls
to 3/4 of the amplitude where g falls to one half. Beyond its ends the motion is continued point
symmetrically, so that the ends stay where they are.

Impacts and quick gestures are above the cutoff, too, but now and then; jitter is always there.
So a motion is smoothed as far as most of its poses shake, and one that doesn't shake is left alone.

Sharpening: a VAE's decoder passes movement above 3 Hz at half of its size, and what is above 5 Hz
at a third. So a generated motion gets it back, as far as a joint has any of it:

    y = x + 3.5 w (x − smooth(x)),   w from 0 to 1 by the size of what is smoothed away

On reconstructions of training clips this gives energies above 3 and 5 Hz and the 99th percentile of
jerk of the clips themselves, for 0.1 mm of error; w keeps bodies at rest as calm as they are.

Timing: a body that is nearly at rest comes to rest, and a motion settles at its ends.

A denoiser spreads movement evenly over time: hands drift where people stand still, and the first
and last frames are as fast as any. The poses are right, so they stay; what changes is when they are
shown:

    ds/dt = c · e(t) · g(s),   1 ≤ c ≤ 1.25

g is low where nothing moves fast, so slow moments last longer; e falls at the ends, unless the body
travels or nothing carries it, since a step or a jump can't slow down in the middle. The largest
pace c and the least slowing are taken for which the last moment with fast movement is still shown,
and a motion whose length nobody gave gets longer for it; generated wrists and feet are slower than
recorded ones by more than c. A motion that begins or
ends in the air, or on one leg in the middle of a kick, is shown from where it stands, or up to
there.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import Lengths, dot, held, length, running_maximum
from latentmotion.cleanup.contacts import ramp, velocity
from latentmotion.kinematics.plausibility import unfinished
from latentmotion.kinematics.skeleton import HUMANML3D, BatchedJoints, Joints, Skeleton
from latentmotion.measure.signals import spans

# Numbers of each frame.
Values = Float[np.ndarray, "frames ..."]


def smooth(values: Values, fps: float, cutoff: float, lengths: Lengths = None) -> Values:
    """Smooths along the first axis.

    Args:
        values: Positions, or any other smooth quantity.
        fps: Frames per second.
        cutoff: Frequency, hertz, that keeps three quarters of its amplitude.
        lengths: As for `gaussian`.
    """
    deviation = np.sqrt(np.log(2) / 2) / np.pi * fps / cutoff
    once = gaussian(values, deviation, lengths)
    return 2 * once - gaussian(once, deviation, lengths)


# Meters above the cutoff, median of frames and joints, from which a motion shakes a little, and
# fully. Of recordings 90 in 100 have less than 1.5 mm, and generated motions; with noise of 2 mm
# a coordinate they have 1.3 to 2.2.
_SHAKING = (0.0015, 0.0025)


def steadied(
    joints: BatchedJoints, fps: float, cutoff: float, lengths: Lengths = None
) -> BatchedJoints:
    """Smooths motions as far as they shake.

    Args:
        joints: Positions, meters.
        fps: Frames per second.
        cutoff: Hertz, as for `smooth`.
        lengths: As for `gaussian`.
    """
    shaking = joints - smooth(joints, fps, cutoff, lengths)
    sizes, counts = length(shaking), [len(joints)] * joints.shape[1]
    counts = counts if lengths is None else lengths.tolist()
    level = np.array([np.median(sizes[:count, n]) for n, count in enumerate(counts)])
    low, high = _SHAKING
    share = np.clip((level - low) / (high - low), 0, 1)
    return joints - share[:, None, None] * shaking if share.any() else joints


# Hertz, as for `smooth`, and gain of what is above.
_SHARP_CUTOFF, _SHARP_GAIN = 4.5, 3.5

# Meters above the cutoff from which a joint is sharpened, and fully; and seconds of their mean.
_QUICK, _QUICK_SECONDS = (0.0005, 0.003), 0.1


def sharpened(joints: Joints, fps: float) -> Joints:
    """Returns a motion with quick movement as large as in recordings.

    Args:
        joints: Positions, meters, as a VAE decodes them.
        fps: Frames per second.
    """
    quick = joints - smooth(joints, fps, _SHARP_CUTOFF)
    size = np.sqrt(gaussian(dot(quick, quick), _QUICK_SECONDS * fps).clip(0))
    return joints + _SHARP_GAIN * ramp(size, *_QUICK)[..., None] * quick


def gaussian(values: Values, deviation: float, lengths: Lengths = None) -> Values:
    """Returns Gaussian means along the first axis, both ends unchanged.

    Args:
        values: One row per frame.
        deviation: Standard deviation of the Gaussian, frames.
        lengths: Frames of each motion of a padded batch, more than three deviations.
    """
    reach = min(int(np.ceil(3 * deviation)), len(values) - 1)
    weights = np.exp(-0.5 * (np.arange(reach + 1) / max(deviation, 1e-9)) ** 2)
    weights /= 2 * weights.sum() - weights[0]
    before = 2 * values[:1] - values[reach:0:-1]
    after = 2 * values[-1:] - values[-2 : -2 - reach : -1]
    padded, count = np.concatenate([before, values, after]), len(values)
    for motion, end in enumerate(() if lengths is None else lengths.tolist()):
        whole = values[:end, motion]
        beyond = padded[reach + end : 2 * reach + end, motion]
        beyond[:] = 2 * whole[-1:] - whole[-2 : -2 - reach : -1]
    means = weights[0] * values
    for n in range(1, reach + 1):
        both = padded[reach - n : reach - n + count] + padded[reach + n : reach + n + count]
        means += weights[n] * both
    return means


def upper_envelope(values: Values, reach: int, lengths: Lengths = None) -> Values:
    """Returns a smooth curve that is nowhere below `values`: moving maximum, then moving mean.

    Args:
        values: One row per frame.
        reach: Frames to either side that a peak is spread over, twice.
        lengths: Frames of each motion of a padded batch.
    """
    if not values.any():  # as it is mostly: nothing below the floor, no leg too short
        return np.zeros(values.shape)
    last, width = len(values) - 1, 2 * reach + 1
    padded = held(values, lengths)[np.clip(np.arange(-2 * reach, last + 2 * reach + 1), 0, last)]
    peaks = running_maximum(padded, width)
    weights = np.hanning(width + 2)[1:-1]
    windows = np.lib.stride_tricks.sliding_window_view(peaks, width, axis=0)
    return windows @ (weights / weights.sum())


# Meters a second of the fastest joint: below the first the body idles, above the second it acts.
# Where people stand still, the fastest joint has 0.15 in the middle, and below 0.46 in nine of
# ten frames; where generated ones do, it has 0.5.
_SPEEDS = (0.6, 1.3)

# Meters a second of the pelvis: the same, since a slow walk is no rest.
_WALK = (0.2, 0.5)

# Meters a second of the fastest joint, and share of the motion's highest, above which movement
# has to be shown to its end.
_SHOWN, _SHOWN_SHARE = 0.7, 0.5

# Pace of a body that idles, the highest of one that acts, and those of the first and last frame.
_IDLE, _MOST_PACE, _END_PACES = 0.15, 1.25, (0.4, 0.3)

# Seconds that rest gets longer at most, at the start of a motion that goes some meters, and
# elsewhere: who waits longer seems frozen.
_LONGEST_REST, _FAR = (0.3, 2.0), 1.0

# Seconds in which a motion settles.
_SETTLE = 0.5

# Factor by which a motion may get longer for rest.
_LONGEST = 1.35

# Meters a second of the pelvis: below the first a motion settles, above the second not.
_TRAVEL = (0.4, 0.8)

# Meters of the lowest joint above the floor from which nothing carries the body.
_AIRBORNE = 0.08

# Seconds, and share of the motion, that an end may be cut by; meters of `unfinished` that
# are saved by it at least.
_CUT, _CUT_SHARE, _SAVED = 0.6, 0.15, 0.08


def settled(
    joints: Joints, fps: float, skeleton: Skeleton = HUMANML3D, longest: int = 0
) -> Float[np.ndarray, "longer joints 3"]:
    """Returns the motion with slow moments slower, and ends that settle.

    Args:
        joints: Positions, meters, the floor at height 0.
        fps: Frames per second.
        skeleton: Says what feet are.
        longest: Frames up to which it may get longer, by a third at most.
    """
    last = len(joints) - 1
    reach = min(round(_SETTLE * fps), last)
    if reach < 2:
        return joints
    first, end = _finished(joints, fps, skeleton)
    if (first, end) != (0, last):
        joints = _between(joints, np.linspace(first, end, last + 1))
    speed = length(velocity(joints, fps))
    fastest = gaussian(speed.max(axis=-1), 0.1 * fps)
    busy = np.maximum(ramp(fastest, *_SPEEDS), ramp(speed[:, 0], *_WALK))
    longer = 1 / (_IDLE + (1 - _IDLE) * busy) - 1
    for start, end in spans(longer > 1):
        travels = start == 0 and np.ptp(joints[:, 0, ::2], axis=0).max() > _FAR
        most = _LONGEST_REST[0 if travels else 1] * fps
        longer[start:end] *= min(1.0, most / longer[start:end].sum())
    pace = 1 / (1 + longer)
    frames, ease = np.arange(last + 1), np.ones(last + 1)
    for part, slowest, away in zip(
        (slice(reach), slice(-reach, None)), _END_PACES, (frames, last - frames), strict=True
    ):
        carried = (joints[part, :, 1].min(axis=1) < _AIRBORNE).all()
        calm = carried * (1 - float(ramp(speed[part, 0].mean(), *_TRAVEL)))
        ease *= 1 - calm * (1 - slowest) * (1 - ramp(away, 0, reach))
    acts = np.flatnonzero(fastest > min(_SHOWN, _SHOWN_SHARE * fastest.max()))
    needed = float(acts[-1]) if len(acts) else 0.0
    rest = min(reach, last - needed)
    elapsed = np.concatenate([[0.0], np.cumsum((ease[1:] + ease[:-1]) / 2)])
    most = max(last, min(round(last * _LONGEST), longest - 1))
    for slowing in np.linspace(1, 0, 11):
        times = np.concatenate([[0.0], np.cumsum(1 / (1 - slowing * (1 - pace[:-1])))])
        # Frames at the highest pace that show all that acts, and what comes to rest after it.
        enough = (np.interp(needed, frames, times) + rest) / _MOST_PACE
        further = max(0, int(np.ceil(enough - elapsed[-1])))
        if last + further <= most:
            break
    else:
        return joints
    ease = np.insert(ease, last // 2, np.ones(further))
    elapsed = np.concatenate([[0.0], np.cumsum((ease[1:] + ease[:-1]) / 2)])
    pace_of_all = max(enough * _MOST_PACE / elapsed[-1], 1.0)
    at = np.interp(pace_of_all * elapsed, times, frames)
    return _between(joints, at)


def _between(
    joints: Joints, at: Float[np.ndarray, " moments"]
) -> Float[np.ndarray, "moments joints 3"]:
    """Returns poses at moments between frames, by Catmull and Rom's cubics."""
    last = len(joints) - 1
    first = np.minimum(at.astype(int), last - 1)
    u = (at - first)[:, None, None]
    a, b, c, d = (joints[np.clip(first + n, 0, last)] for n in (-1, 0, 1, 2))
    return b + 0.5 * u * (c - a + u * (2 * a - 5 * b + 4 * c - d + u * (3 * (b - c) + d - a)))


def _finished(joints: Joints, fps: float, skeleton: Skeleton) -> tuple[int, int]:
    """Returns the first and the last frame between which a motion begins and ends on its feet."""
    last = len(joints) - 1
    reach = round(min(_CUT * fps, _CUT_SHARE * last))
    height = unfinished(joints, skeleton)
    cost = height + _SAVED * np.arange(last + 1) / max(reach, 1)
    first = int(cost[: reach + 1].argmin())
    cost = height[::-1] + _SAVED * np.arange(last + 1) / max(reach, 1)
    end = last - int(cost[: reach + 1].argmin())
    return (
        first if height[0] - height[first] > _SAVED else 0,
        end if height[last] - height[end] > _SAVED else last,
    )


def spread(
    offsets: dict[int, np.ndarray], frames: int, blend: float
) -> Float[np.ndarray, "frames 3"]:
    """Returns a curve through offsets at some frames, with continuous velocity.

    Between two that are near one goes over to the other, elsewhere to zero. At the ends of a run of
    frames, one after the other, the curve goes on as fast as the offsets change there.

    Args:
        offsets: By frame.
        frames: Length of the curve.
        blend: Frames in which an offset comes and goes.
    """
    frames_given = sorted(offsets)
    curve, still = np.zeros((frames, 3)), np.zeros(3)
    if not frames_given:
        return curve

    def rate(frame: int, ahead: int) -> np.ndarray:
        """Returns the change per frame at the end of a run that lies ahead (1) or behind (-1)."""
        near = [offsets.get(frame + n * ahead) for n in range(3)]
        if any(offset is None for offset in near) or frame - ahead in offsets:
            return still
        return ahead * (-1.5 * near[0] + 2 * near[1] - 0.5 * near[2])  # type: ignore[operator]

    # Frame, offset, and its change per frame, on either side.
    knots = [(frames_given[0] - blend, still, still, still)]
    for frame, later in zip(frames_given, [*frames_given[1:], None], strict=True):
        knots.append(
            (float(frame), np.asarray(offsets[frame], float), rate(frame, 1), rate(frame, -1))
        )
        if later is None:
            knots.append((frame + blend, still, still, still))
        elif later - frame > 2 * blend:
            knots += [(at, still, still, still) for at in (frame + blend, later - blend)]
    time = np.arange(frames)
    for (start, a, _, leaving), (end, b, meeting, _) in pairwise(knots):
        inside, length = (time >= start) & (time <= end), max(end - start, 1e-9)
        u = ((time[inside] - start) / length)[:, None]
        ease = quintic(u)
        rates = rate_left(u) * leaving - rate_left(1 - u) * meeting
        curve[inside] = (1 - ease) * a + ease * b + length * rates
    return curve


def quintic(u: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Returns a step from 0 to 1 whose velocity and acceleration are 0 at both ends."""
    return u**3 * (10 - 15 * u + 6 * u**2)


def rate_left(u: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Returns a curve of slope 1 at 0; all else of it, to its acceleration, is 0 at both ends."""
    return u * (1 - u) ** 3 * (1 + 3 * u)
