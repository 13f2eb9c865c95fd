"""R-precision: how often a caption's own motion is among the k nearest of a group of 32.

For each caption the motions of its group are ranked by their distance to it; top-k is the share of
captions whose own motion is among the first k. Guo et al. 2022, section 6.1.

A motion that is as far as the caption's own ranks after it, as in the authors' stable sort only
if it also comes later; vectors of real numbers have no such ties.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from latentmotion.evaluation.metrics.distances import distances

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
