"""Smoothing: removes jitter without delay and keeps both end points.

    y = (2g − g∗g) ∗ x,   g a Gaussian

2g − g∗g keeps straight lines, parabolas and cubics unchanged, and so the peak of a kick; it falls
to 3/4 of the amplitude where g falls to one half. Beyond its ends the motion is continued point
symmetrically, so that the ends stay where they are.

Impacts and quick gestures are above the cutoff, too, but now and then; jitter is always there.
So a motion is smoothed as far as most of its poses shake, and one that doesn't shake is left alone.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


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


_SHAKING = (0.0015, 0.0025)
"""Meters above the cutoff, median of frames and joints, from which a motion shakes a little, and
fully. Of recordings 90 in 100 have less than 1.5 mm, and generated motions; with noise of 2 mm a
coordinate they have 1.3 to 2.2."""


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
