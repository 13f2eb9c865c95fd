"""Diversity: the mean distance between two motions of a set, whatever they were asked for.

Guo et al. 2020, "Action2Motion", section 5: mean over random pairs of |f_a − f_b|. `diversity` is
what that estimates, the mean over all pairs of different motions; the drawn form is the authors'.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from latentmotion.evaluation.metrics.distances import distances

_ROWS = 1024


def diversity(features: Float[np.ndarray, "items width"]) -> float:
    """Returns the mean distance over all pairs of different items; 0 for a single one."""
    items = len(features)
    starts = range(0, items, _ROWS)
    total = sum(distances(features[s : s + _ROWS], features).sum() for s in starts)
    return float(total) / (items * (items - 1)) if items > 1 else 0.0


def drawn_diversity(
    features: Float[np.ndarray, "items width"],
    one: Int[np.ndarray, " pairs"],
    other: Int[np.ndarray, " pairs"],
) -> float:
    """Returns the mean distance of the given pairs.

    Args:
        features: One row per motion.
        one: First item of each pair.
        other: Second item of each pair; the authors' draws let it be the same.
    """
    return float(np.linalg.norm(features[one] - features[other], axis=1).mean())
