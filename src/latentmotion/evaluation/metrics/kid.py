"""KID: the squared maximum mean discrepancy of two sets of features, without bias.

    k(x, y) = (x·y / width + 1)³
    mean k(x, x') + mean k(y, y') − 2 mean k(x, y),   x ≠ x' and y ≠ y'

Bińkowski et al. 2018, "Demystifying MMD GANs", section 3. Unlike FID's, its mean does not depend
on the number of motions: the measure for small sets. Around zero it can be negative.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError


def kid(
    generated: Float[np.ndarray, "items width"],
    real: Float[np.ndarray, "others width"],
    paired: bool = False,
) -> float:
    """Returns the unbiased estimate from all pairs.

    Args:
        generated: One row per generated motion.
        real: One row per real motion.
        paired: Whether row k of both answers the same question. Such rows are near each other for
            that reason alone, and are not compared (Gretton et al. 2012, eq. 4).

    Raises:
        InputError: One of the sets has fewer than two motions.
    """
    if min(len(generated), len(real)) < 2:
        raise InputError(f"KID needs two motions or more: {len(generated)} and {len(real)}")
    x, y = np.asarray(generated, np.float64), np.asarray(real, np.float64)
    across = _off_diagonal(_kernel(x, y)) if paired else float(_kernel(x, y).mean())
    return _within(x) + _within(y) - 2 * across


def drawn_kid(
    generated: Float[np.ndarray, "items width"],
    real: Float[np.ndarray, "others width"],
    subsets: int,
    size: int,
    generator: np.random.Generator,
) -> float:
    """Returns the mean of the estimates from random subsets, as `UncondMetrics` of the authors.

    Args:
        generated: One row per generated motion.
        real: One row per real motion.
        subsets: How many subsets.
        size: Motions of each; no more than there are.
        generator: Source of randomness.
    """
    size = min(size, len(generated), len(real))

    def part(features: Float[np.ndarray, "_ width"]) -> Float[np.ndarray, "_ width"]:
        return features[generator.permutation(len(features))[:size]]

    return float(np.mean([kid(part(generated), part(real)) for _ in range(subsets)]))


def _within(features: Float[np.ndarray, "items width"]) -> float:
    return _off_diagonal(_kernel(features, features))


def _off_diagonal(kernel: Float[np.ndarray, "items items"]) -> float:
    return float(kernel.sum() - np.trace(kernel)) / (len(kernel) * (len(kernel) - 1))


def _kernel(
    x: Float[np.ndarray, "items width"], y: Float[np.ndarray, "others width"]
) -> Float[np.ndarray, "items others"]:
    return (x @ y.T / x.shape[1] + 1) ** 3
