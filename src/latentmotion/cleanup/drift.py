"""Drift: a body that slides along the floor on planted feet is moved back as a whole.

Where feet slide with the body above them, legs alone would have to lean to hold them. A correction
r of the root, smooth in time, takes what it can. With p the path of a foot that bears, w how surely
it does, and means over each contact,

    minimize   Σ w |(p + r) − mean (p + r)|²  +  a Σ |z|²,     r = g ∗ z,   g a Gaussian,

over z by conjugate gradients. The second term keeps the body where it was wherever that costs legs
little: r goes back to nothing as soon as feet allow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.bearing import Bearing, Path

_ROUNDS = 12


def drift_correction(feet: Sequence[Bearing], deviation: float, stay: float) -> Path:
    """Returns how far the body is moved in each frame for its planted feet to slide least.

    Args:
        feet: How each foot bears.
        deviation: Of the Gaussian g, frames.
        stay: a, the weight of staying: the larger, the less the body is moved.
    """
    frames = len(feet[0].path)
    window = _gaussian(deviation, frames)
    contacts = [(slice(*p), foot.weight[slice(*p), None]) for foot in feet for p in foot.periods]

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
        for period in foot.periods:
            part = slice(*period)
            slides[part] += _off_center(foot.path[part], foot.weight[part, None])
    return spread(_conjugate_gradients(normal, -spread(slides)))


def _off_center(path: Path, weight: Float[np.ndarray, "frames 1"]) -> Path:
    """Returns how far a path is from its weighted mean, times the weight."""
    return weight * (path - (weight * path).sum(axis=0) / weight.sum())


def _gaussian(deviation: float, frames: int) -> Float[np.ndarray, " width"]:
    reach = min(int(np.ceil(3 * deviation)), frames - 1)
    window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    return window / window.sum()


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
