"""Diversity and MultiModality.

Diversity: the mean distance between two motions of a set, whatever their prompts.

Guo et al. 2020, "Action2Motion", section 5: mean over random pairs of |f_a − f_b|. `diversity` is
what that estimates, the mean over all pairs of different motions; the drawn form is the authors'.

MultiModality: the mean distance between two motions of one caption, or of one label.

    mean over captions c and pairs a ≠ b of its motions of |f_ca − f_cb|

Guo et al. 2020, "Action2Motion", section 5 (labels); Guo et al. 2022, section 6.1 (captions).
`multimodality` is the mean over all pairs of different motions; the drawn forms are the authors'.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import fmean

import numpy as np
from jaxtyping import Float, Int

from latentmotion.evaluation.metrics.retrieval import distances

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


def multimodality(groups: Sequence[Float[np.ndarray, "_ width"]]) -> float:
    """Returns the mean distance over all pairs of a group, averaged over the groups.

    Args:
        groups: Features of the motions of each caption or label; those of one motion are left out.
    """
    return fmean([diversity(group) for group in groups if len(group) > 1] or [0.0])


def shared_pairs_multimodality(
    groups: Float[np.ndarray, "captions samples width"],
    one: Int[np.ndarray, " pairs"],
    other: Int[np.ndarray, " pairs"],
) -> float:
    """Returns the mean distance of the same pairs of samples of every caption.

    Args:
        groups: Features of the motions of each caption.
        one: First sample of each pair.
        other: Second sample of each pair; it can be the same.
    """
    return float(np.linalg.norm(groups[:, one] - groups[:, other], axis=2).mean())


def label_pairs(
    labels: Int[np.ndarray, " items"], quota: int, draw: Callable[[int], int]
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """Draws pairs of the same label as the authors do; `drawn_diversity` of them is theirs.

    An item is drawn, and another if its label has all its pairs; then second items are drawn until
    one has the same label, which can be the first again.

    Args:
        labels: Label of each item.
        quota: Pairs of each label that occurs.
        draw: Returns a random number below its argument.
    """
    left = {int(label): quota for label in np.unique(labels)}
    pairs: list[tuple[int, int]] = []
    while any(left.values()):
        one = draw(len(labels))
        label = int(labels[one])
        if left[label]:
            left[label] -= 1
            while labels[other := draw(len(labels))] != label:
                pass
            pairs.append((one, other))
    first, second = np.array(pairs).T
    return first, second
