"""Conditions: a sentence, a label or nothing becomes words, each a vector.

Two steps, so that embeddings can be kept on disk in training: a text encoder turns sentences into
a `TextEmbedding`; from it, or from a label, a `Conditioning` is made, which is all a denoiser sees.
Every implementation is checked (tests/condition/test_conditions.py) for this:
the order in the batch does not matter, neither does the company a sentence is in, and the null
condition depends on no input.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True)
class Conditioning:
    """The condition of a batch of motions, NumPy or torch."""

    tokens: Float[Any, "batch words width"]
    """One vector per word; a pooled sentence or a label is one word."""
    mask: Bool[Any, "batch words"]
    """True on real words."""


@dataclass(frozen=True)
class TextEmbedding:
    """Embeddings of a batch of sentences, NumPy or torch."""

    pooled: Float[Any, "batch width"]
    """One vector per sentence."""
    words: Float[Any, "batch words _"]
    """One vector per word piece, zero where there is none; CLIP's may be of another width."""
    mask: Bool[Any, "batch words"]
    """True on real word pieces."""


@runtime_checkable
class Condition(Protocol):
    """Sentences, labels or nothing to what a denoiser sees."""

    def __call__(self, inputs: Sequence[Any]) -> Conditioning:
        """Returns the condition of each input.

        Raises:
            InputError: An input is not of this condition's kind.
        """
        ...

    def null(self, count: int) -> Conditioning:
        """Returns `count` rows of no condition, the same whatever the inputs are."""
        ...


@runtime_checkable
class TextEncoder(Protocol):
    """Sentences to embeddings. The empty sentence is allowed: it is the null condition's."""

    @property
    def name(self) -> str:
        """What distinguishes this encoder's embeddings from any other's."""
        ...

    @property
    def width(self) -> int:
        """Numbers per vector."""
        ...

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns the embeddings of at least one sentence, float32.

        Raises:
            InputError: There is no sentence.
        """
        ...


def stack(rows: Sequence[TextEmbedding]) -> TextEmbedding:
    """Returns several embeddings as one batch, words filled with zeros to the longest."""
    if len(rows) == 1:
        return rows[0]
    longest = max(row.mask.shape[1] for row in rows)
    count = sum(len(row.mask) for row in rows)
    words = np.zeros((count, longest, rows[0].words.shape[2]), rows[0].words.dtype)
    mask, at = np.zeros((count, longest), bool), 0
    for row in rows:
        part = slice(at, at := at + len(row.mask)), slice(row.mask.shape[1])
        words[part], mask[part] = row.words, row.mask
    return TextEmbedding(np.concatenate([row.pooled for row in rows]), words, mask)
