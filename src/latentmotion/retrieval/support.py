"""Support of a sentence: the number of clips that have one of nearly the same meaning.

    support(s) = #{clips with a caption c : cos(embedding(s), embedding(c)) ≥ 0.7}

It tells rare movements from frequent ones without a list of words: "a person sweeps the floor" has
a support of 1, "a person walks forward" one of 1,800 (lab/diary/rare_acts.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

NEAR = 0.7
"""Cosine of pooled embeddings from which two sentences usually name the same movement."""

_AT_ONCE = 512
"""Sentences that are compared with all captions together."""


def support(
    sentences: Float[np.ndarray, "sentences width"],
    captions: Float[np.ndarray, "captions width"],
    clips: Sequence[Sequence[int]],
    near: float = NEAR,
) -> Int[np.ndarray, " sentences"]:
    """Returns how many clips have a caption near each sentence.

    Args:
        sentences: Pooled embeddings of unit length.
        captions: Those of different captions.
        clips: Rows of the captions of each clip; every clip has at least one.
        near: Least cosine.
    """
    if not clips:
        return np.zeros(len(sentences), np.int64)
    rows = np.concatenate([np.asarray(own, np.int64) for own in clips])
    starts = np.cumsum([0, *(len(own) for own in clips[:-1])])
    counts = []
    for first in range(0, len(sentences), _AT_ONCE):
        close = sentences[first : first + _AT_ONCE] @ captions.T >= near
        counts.append(np.logical_or.reduceat(close[:, rows], starts, axis=1).sum(axis=1))
    return np.concatenate(counts)
