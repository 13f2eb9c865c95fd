"""Distances between vectors, which several metrics start from."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def distances(
    rows: Float[np.ndarray, "rows width"], columns: Float[np.ndarray, "columns width"]
) -> Float[np.ndarray, "rows columns"]:
    """Returns the Euclidean distance of each row to each column, in float64.

    By |a − b|² = |a|² − 2 a·b + |b|²; what rounding makes negative is zero.
    """
    a, b = np.asarray(rows, np.float64), np.asarray(columns, np.float64)
    squared = (a**2).sum(1)[:, None] - 2 * a @ b.T + (b**2).sum(1)
    return np.sqrt(np.maximum(squared, 0))
