"""Smoothing: removes jitter without delay and keeps both end points.

    y = (2g − g∗g) ∗ x,   g a Gaussian

2g − g∗g keeps straight lines, parabolas and cubics unchanged, and so the peak of a kick; it falls
to 3/4 of the amplitude where g falls to one half. Beyond its ends the motion is continued point
symmetrically, so that the ends stay where they are.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def smooth(
    values: Float[np.ndarray, frames * channels], fps: float, cutoff: float
) -> Float[np.ndarray, frames * channels]:
    """Smooths along the first axis.

    Args:
        values: Positions, or any other smooth quantity.
        fps: Frames per second.
        cutoff: Frequency, hertz, that keeps three quarters of its amplitude.
    """
    deviation = np.sqrt(np.log(2) / 2) / np.pi * fps / cutoff
    return 2 * gaussian(values, deviation) - gaussian(gaussian(values, deviation), deviation)


def gaussian(
    values: Float[np.ndarray, frames * channels], deviation: float
) -> Float[np.ndarray, frames * channels]:
    """Returns Gaussian means along the first axis, both ends unchanged.

    Args:
        values: One row per frame.
        deviation: Standard deviation of the Gaussian, frames.
    """
    reach = min(int(np.ceil(3 * deviation)), len(values) - 1)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(deviation, 1e-9)) ** 2)
    before = 2 * values[:1] - values[reach:0:-1]
    after = 2 * values[-1:] - values[-2 : -2 - reach : -1]
    padded = np.concatenate([before, values, after])
    windows = [padded[n : n + len(values)] for n in range(2 * reach + 1)]
    return np.tensordot(weights / weights.sum(), np.stack(windows), axes=1)


def upper_envelope(
    values: Float[np.ndarray, " frames"], reach: int
) -> Float[np.ndarray, " frames"]:
    """Returns a smooth curve that is nowhere below `values`: moving maximum, then moving mean.

    Args:
        values: One number per frame.
        reach: Frames to either side that a peak is spread over, twice.
    """
    padded = np.pad(values, 2 * reach, mode="edge")
    width = 2 * reach + 1
    peaks = np.lib.stride_tricks.sliding_window_view(padded, width).max(axis=-1)
    weights = np.hanning(width + 2)[1:-1]
    return np.convolve(peaks, weights / weights.sum(), mode="valid")
