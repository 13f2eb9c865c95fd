"""Smoothing: removes jitter without delay and keeps both end points.

    y = (2g − g∗g) ∗ x,   g a Gaussian

2g − g∗g keeps straight lines, parabolas and cubics unchanged, and so the peak of a kick; it falls
to 3/4 of the amplitude where g falls to one half. Beyond its ends the motion is continued point
symmetrically, so that the ends stay where they are.

Impacts and quick gestures are above the cutoff, too, but now and then; jitter is always there.
So a motion is smoothed as far as most of its poses shake, and one that doesn't shake is left alone.

Timing: a body that is nearly at rest comes to rest, and a motion settles at its end.

A denoiser spreads movement evenly over time: hands drift where people stand still, and the last
frame is as fast as any. The poses are right, so they stay; what changes is when they are shown:

    ds/dt = c · e(t) · g(s),   1 ≤ c ≤ 1.12

g is low where nothing moves fast, so slow moments last longer; e falls at the end, unless the body
travels or nothing carries it, since a step or a jump can't slow down in the middle. The largest
pace c and the least slowing are taken for which the last moment with fast movement is still shown.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.contacts import ramp, velocity


def smooth(
    values: Float[np.ndarray, "frames ..."], fps: float, cutoff: float
) -> Float[np.ndarray, "frames ..."]:
    """Smooths along the first axis.

    Args:
        values: Positions, or any other smooth quantity.
        fps: Frames per second.
        cutoff: Frequency, hertz, that keeps three quarters of its amplitude.
    """
    deviation = np.sqrt(np.log(2) / 2) / np.pi * fps / cutoff
    once = gaussian(values, deviation)
    return 2 * once - gaussian(once, deviation)


# Meters above the cutoff, median of frames and joints, from which a motion shakes a little, and
# fully. Of recordings 90 in 100 have less than 1.5 mm, and generated motions; with noise of 2 mm
# a coordinate they have 1.3 to 2.2.
_SHAKING = (0.0015, 0.0025)


def steadied(
    joints: Float[np.ndarray, "frames motions joints 3"], fps: float, cutoff: float
) -> Float[np.ndarray, "frames motions joints 3"]:
    """Smooths motions as far as they shake.

    Args:
        joints: Positions, meters.
        fps: Frames per second.
        cutoff: Hertz, as for `smooth`.
    """
    shaking = joints - smooth(joints, fps, cutoff)
    level = np.median(np.sqrt((shaking**2).sum(axis=-1)), axis=(0, 2))
    low, high = _SHAKING
    share = np.clip((level - low) / (high - low), 0, 1)
    return joints - share[:, None, None] * shaking


def gaussian(
    values: Float[np.ndarray, "frames ..."], deviation: float
) -> Float[np.ndarray, "frames ..."]:
    """Returns Gaussian means along the first axis, both ends unchanged.

    Args:
        values: One row per frame.
        deviation: Standard deviation of the Gaussian, frames.
    """
    reach = min(int(np.ceil(3 * deviation)), len(values) - 1)
    weights = np.exp(-0.5 * (np.arange(reach + 1) / max(deviation, 1e-9)) ** 2)
    weights /= 2 * weights.sum() - weights[0]
    before = 2 * values[:1] - values[reach:0:-1]
    after = 2 * values[-1:] - values[-2 : -2 - reach : -1]
    padded, count = np.concatenate([before, values, after]), len(values)
    means = weights[0] * values
    for n in range(1, reach + 1):
        both = padded[reach - n : reach - n + count] + padded[reach + n : reach + n + count]
        means += weights[n] * both
    return means


def upper_envelope(
    values: Float[np.ndarray, "frames ..."], reach: int
) -> Float[np.ndarray, "frames ..."]:
    """Returns a smooth curve that is nowhere below `values`: moving maximum, then moving mean.

    Args:
        values: One row per frame.
        reach: Frames to either side that a peak is spread over, twice.
    """
    if not values.any():  # as it is mostly: nothing below the floor, no leg too short
        return np.zeros(values.shape)
    last, width = len(values) - 1, 2 * reach + 1
    padded = values[np.clip(np.arange(-2 * reach, last + 2 * reach + 1), 0, last)]
    peaks = np.lib.stride_tricks.sliding_window_view(padded, width, axis=0).max(axis=-1)
    weights = np.hanning(width + 2)[1:-1]
    windows = np.lib.stride_tricks.sliding_window_view(peaks, width, axis=0)
    return windows @ (weights / weights.sum())


Joints = Float[np.ndarray, "frames joints 3"]


# Meters a second of the fastest joint: below the first the body idles, above the second it acts.
# Where people stand still, the fastest joint has 0.15 in the middle, and below 0.46 in nine of
# ten frames; where generated ones do, it has 0.5.
_SPEEDS = (0.3, 0.7)

# Pace of a body that idles, the highest of one that acts, and that of the last frame.
_IDLE, _MOST_PACE, _LAST_PACE = 0.3, 1.12, 0.2

# Seconds in which a motion settles.
_SETTLE = 0.5

# Meters a second of the pelvis: below the first a motion settles, above the second not.
_TRAVEL = (0.4, 0.8)

# Meters of the lowest joint above the floor from which nothing carries the body.
_AIRBORNE = 0.08


def settled(joints: Joints, fps: float) -> Joints:
    """Returns as many frames of the motion, slow moments slower, with an end that settles.

    Args:
        joints: Positions, meters, the floor at height 0.
        fps: Frames per second.
    """
    last = len(joints) - 1
    reach = min(round(_SETTLE * fps), last)
    if reach < 2:
        return joints
    speed = np.linalg.norm(velocity(joints, fps), axis=-1)
    fastest = gaussian(speed.max(axis=-1), 0.1 * fps)
    pace = _IDLE + (1 - _IDLE) * ramp(fastest, *_SPEEDS)
    carried = (joints[-reach:, :, 1].min(axis=1) < _AIRBORNE).all()
    calm = carried * (1 - float(ramp(speed[-reach:, 0].mean(), *_TRAVEL)))
    frames = np.arange(last + 1)
    ease = 1 - calm * (1 - _LAST_PACE) * ramp(frames, last - reach, last)
    elapsed = np.concatenate([[0.0], np.cumsum((ease[1:] + ease[:-1]) / 2)])
    acts = np.flatnonzero(fastest > _SPEEDS[1])
    needed = min(acts[-1], elapsed[-1]) if len(acts) else 0.0
    at = elapsed
    for slowing in (1.0, 0.75, 0.5, 0.25, 0.0):
        times = np.concatenate([[0.0], np.cumsum(1 / (1 - slowing * (1 - pace[:-1])))])
        enough = np.interp(needed, frames, times) / elapsed[-1]  # the pace that shows it
        if enough <= _MOST_PACE:
            at = np.interp(max(enough, 1.0) * elapsed, times, frames)
            break
    # Moments between frames, by Catmull and Rom's cubics.
    first = np.minimum(at.astype(int), last - 1)
    u = (at - first)[:, None, None]
    a, b, c, d = (joints[np.clip(first + n, 0, last)] for n in (-1, 0, 1, 2))
    return b + 0.5 * u * (c - a + u * (2 * a - 5 * b + 4 * c - d + u * (3 * (b - c) + d - a)))


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
    known = sorted(offsets)
    curve, still = np.zeros((frames, 3)), np.zeros(3)
    if not known:
        return curve

    def rate(frame: int, ahead: int) -> np.ndarray:
        """Returns the change per frame at the end of a run that lies ahead (1) or behind (-1)."""
        near = [offsets.get(frame + n * ahead) for n in range(3)]
        if any(offset is None for offset in near) or frame - ahead in offsets:
            return still
        return ahead * (-1.5 * near[0] + 2 * near[1] - 0.5 * near[2])  # type: ignore[operator]

    # Frame, offset, and its change per frame, on either side.
    knots = [(known[0] - blend, still, still, still)]
    for frame, later in zip(known, [*known[1:], None], strict=True):
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
