"""Agreement with prompts: R-precision, MM-Dist, accuracy of a classifier.

R-precision: how often a caption's own motion is among the k nearest of a group of 32.

For each caption the motions of its group are ranked by their distance to it; top-k is the share of
captions whose own motion is among the first k. Guo et al. 2022, section 6.1.

A motion that is as far as the caption's own ranks after it, as in the authors' stable sort only
if it also comes later; vectors of real numbers have no such ties.

MM-Dist: the mean distance between a caption's vector and that of the motion made from it.

    mean over items of |text − motion|

Guo et al. 2022, section 6.1 (their code calls it matching score).

Accuracy: the share of motions whose label a classifier recognizes.

Guo et al. 2020, "Action2Motion", section 5.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int


def distances(
    rows: Float[np.ndarray, "rows width"], columns: Float[np.ndarray, "columns width"]
) -> Float[np.ndarray, "rows columns"]:
    """Returns the Euclidean distance of each row to each column, in float64.

    By |a − b|² = |a|² − 2 a·b + |b|²; what rounding makes negative is zero.
    """
    a, b = np.asarray(rows, np.float64), np.asarray(columns, np.float64)
    squared = (a**2).sum(1)[:, None] - 2 * a @ b.T + (b**2).sum(1)
    return np.sqrt(np.maximum(squared, 0))


BEST = (1, 2, 3)
"""The k that papers report."""


def ranks(
    texts: Float[np.ndarray, "group width"], motions: Float[np.ndarray, "group width"]
) -> Int[np.ndarray, " group"]:
    """Returns the place, from 0, of each caption's own motion among all motions of a group."""
    apart = distances(texts, motions)
    return (apart < np.diagonal(apart)[:, None]).sum(axis=1)


def r_precision(places: Int[np.ndarray, " captions"], best: Sequence[int] = BEST) -> list[float]:
    """Returns the share of captions whose motion is among the first k, for each k.

    Args:
        places: What `ranks` returned, of all groups.
        best: The k.
    """
    return [float((places < k).mean()) for k in best]


def mm_dist(
    texts: Float[np.ndarray, "items width"], motions: Float[np.ndarray, "items width"]
) -> float:
    """Returns the mean distance of the pairs, row by row."""
    apart = np.asarray(texts, np.float64) - np.asarray(motions, np.float64)
    return float(np.linalg.norm(apart, axis=1).mean())


def accuracy(logits: Float[np.ndarray, "items labels"], labels: Int[np.ndarray, " items"]) -> float:
    """Returns the share of rows whose greatest logit is at their label."""
    return float((logits.argmax(axis=1) == labels).mean())
