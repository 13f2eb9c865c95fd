"""Distributions of features: FID and KID.

FID: the Fréchet distance between two sets of features, each taken as one Gaussian.

    |μ₁ − μ₂|² + tr(Σ₁ + Σ₂ − 2 (Σ₁ Σ₂)^½)

Heusel et al. 2017, "GANs trained by a two time-scale update rule", eq. 6; for motion on an
evaluator's features, Guo et al. 2022, section 6.1. Covariances are unbiased (ddof 1).

tr (Σ₁ Σ₂)^½ is the sum of the singular values of Σ₁^½ Σ₂^½: both roots are of symmetric matrices,
so that nothing is complex and covariances of fewer motions than features need no special care.

KID: the squared maximum mean discrepancy of two sets of features, without bias.

    k(x, y) = (x·y / width + 1)³
    mean k(x, x') + mean k(y, y') − 2 mean k(x, y),   x ≠ x' and y ≠ y'

Bińkowski et al. 2018, "Demystifying MMD GANs", section 3. Unlike FID's, its mean does not depend
on the number of motions: the measure for small sets. Around zero it can be negative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from jaxtyping import Float

from latentmotion.errors import InputError


@dataclass(frozen=True)
class Gaussian:
    """Mean and covariance of a set of features."""

    mean: Float[np.ndarray, " width"]
    """Mean."""
    covariance: Float[np.ndarray, "width width"]
    """Unbiased covariance."""

    @classmethod
    def of(cls, features: Float[np.ndarray, "items width"], float32_mean: bool = False) -> Gaussian:
        """Measures a set of features.

        Args:
            features: One row per motion.
            float32_mean: Whether the mean is computed in float32, as the authors do.

        Raises:
            InputError: There are fewer than two, or one is not finite.
        """
        if len(features) < 2 or not np.isfinite(features).all():
            raise InputError(f"FID needs two motions or more with finite features: {len(features)}")
        precision = np.float32 if float32_mean else np.float64
        mean = np.asarray(features, precision).mean(axis=0).astype(np.float64)
        covariance = np.cov(np.asarray(features, np.float64), rowvar=False)
        return cls(mean, np.atleast_2d(covariance))


def frechet_distance(one: Gaussian, other: Gaussian) -> float:
    """Returns the Fréchet distance of two Gaussians; zero for equal ones."""
    apart = one.mean - other.mean
    roots = _root(one.covariance) @ _root(other.covariance)
    overlap = np.sum(scipy.linalg.svdvals(roots))
    spread = np.trace(one.covariance) + np.trace(other.covariance)
    return max(0.0, float(apart @ apart + spread - 2 * overlap))


def fid(
    generated: Float[np.ndarray, "items width"], real: Float[np.ndarray, "others width"]
) -> float:
    """Returns the FID of two sets of features."""
    return frechet_distance(Gaussian.of(generated), Gaussian.of(real))


def _root(
    covariance: Float[np.ndarray, "width width"],
) -> Float[np.ndarray, "width width"]:
    values, vectors = scipy.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T


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
