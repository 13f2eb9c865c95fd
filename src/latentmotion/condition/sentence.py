"""Sentences as a condition: their pooled meaning, their words, or both; null is the empty one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from latentmotion.condition.interface import Conditioning, TextEmbedding, TextEncoder
from latentmotion.errors import InputError


@dataclass(frozen=True)
class SentenceReading:
    """What a denoiser sees of an embedded sentence.

    Pooled embeddings of "left" and "right" differ by a hundredth; words tell them apart.

    Raises:
        InputError: It would see nothing.
    """

    pooled: bool = True
    """Whether the first token is the pooled sentence."""
    words: int = 0
    """How many word pieces follow at the most."""

    def __post_init__(self) -> None:
        if not self.pooled and self.words < 1:
            raise InputError("a condition of sentences needs pooled=true or words of at least 1")

    def __call__(self, embedding: TextEmbedding) -> Conditioning:
        """Returns the tokens of a batch of sentences."""
        words, seen = embedding.words[:, : self.words], embedding.mask[:, : self.words]
        if not self.pooled:
            return Conditioning(words, seen)
        pooled, always = embedding.pooled[:, None], np.ones((len(seen), 1), dtype=bool)
        if not self.words:  # CLIP's words may be of another width than its sentences
            return Conditioning(pooled, always)
        tokens = np.concatenate([pooled, words], axis=1)
        return Conditioning(tokens, np.concatenate([always, seen], axis=1))


@dataclass(frozen=True)
class SentenceCondition:
    """A text encoder as a condition."""

    encoder: TextEncoder
    """Sentences to embeddings."""

    reading: SentenceReading = field(default_factory=SentenceReading)
    """What the denoiser sees of them."""

    def __call__(self, inputs: Sequence[str]) -> Conditioning:
        """Returns the condition of each sentence.

        Raises:
            InputError: There is no sentence.
        """
        return self.reading(self.encoder(inputs))

    def null(self, count: int) -> Conditioning:
        """Returns the empty sentence `count` times (MLD's unconditional prompt)."""
        return self([""] * count)
