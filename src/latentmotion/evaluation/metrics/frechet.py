"""FID: the Fréchet distance between two sets of features, each taken as one Gaussian.

    |μ₁ − μ₂|² + tr(Σ₁ + Σ₂ − 2 (Σ₁ Σ₂)^½)

Heusel et al. 2017, "GANs trained by a two time-scale update rule", eq. 6; for motion on an
evaluator's features, Guo et al. 2022, section 6.1. Covariances are unbiased (ddof 1).

tr (Σ₁ Σ₂)^½ is the sum of the singular values of Σ₁^½ Σ₂^½: both roots are of symmetric matrices,
so that nothing is complex and covariances of fewer motions than features need no special care.
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
