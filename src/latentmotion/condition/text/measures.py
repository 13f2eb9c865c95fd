"""How well a student repeats its teacher on sentences that it was never trained on.

`cosine`: mean cosine between both embeddings of a sentence. `nearest`: sentences are taken in
groups of 33; each is asked which of the 32 others is nearest, by the student's embeddings alone
and by the teacher's alone; the share of equal answers. `own_first`: among the teacher's embeddings
of a group, the share of sentences whose own is the nearest to the student's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

GROUP = 33


@dataclass(frozen=True)
class Figures:
    """Figures of one student, as its card tells them."""

    sentences: int
    """Number of held-out sentences."""

    cosine: float
    """Mean cosine to the teacher."""

    cosine_5_percent: float
    """The cosine that one sentence in twenty stays below."""

    nearest: float
    """Share of sentences with the same nearest among 32 others, by student and by teacher."""

    own_first: float
    """Share of sentences whose own teacher embedding is the nearest among 33."""


def compare(
    student: Float[np.ndarray, "sentences width"], teacher: Float[np.ndarray, "sentences width"]
) -> Figures:
    """Returns the figures of embeddings of unit length, in an order without meaning."""
    cosines = (student * teacher).sum(1)
    groups = [slice(first, first + GROUP) for first in range(0, len(student) - GROUP + 1, GROUP)]
    same = [_nearest_other(student[part]) == _nearest_other(teacher[part]) for part in groups]
    own = [(student[part] @ teacher[part].T).argmax(1) == np.arange(GROUP) for part in groups]
    return Figures(
        sentences=len(student),
        cosine=float(cosines.mean()),
        cosine_5_percent=float(np.percentile(cosines, 5)),
        nearest=float(np.mean(same)),
        own_first=float(np.mean(own)),
    )


def milliseconds(encode: Callable[[list[str]], object], sentences: Sequence[str]) -> float:
    """Returns the median processor time of encoding one sentence.

    Processor time leaves out what other programs do on the same cores.
    """
    encode([sentences[0]])
    times = []
    for sentence in sentences:
        started = time.process_time()
        encode([sentence])
        times.append(time.process_time() - started)
    return 1000 * float(np.median(times))


def _nearest_other(embeddings: Float[np.ndarray, "group width"]) -> np.ndarray:
    similarity = embeddings @ embeddings.T
    np.fill_diagonal(similarity, -np.inf)
    return similarity.argmax(1)
