"""Sentences as a condition: pooled to one word, or word by word; null is the empty sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from latentmotion.condition.interface import Conditioning, TextEncoder


@dataclass(frozen=True)
class SentenceCondition:
    """A text encoder as a condition."""

    encoder: TextEncoder
    """Sentences to embeddings."""

    by_word: bool = False
    """Whether the denoiser sees every word piece instead of the pooled sentence."""

    def __call__(self, inputs: Sequence[str]) -> Conditioning:
        """Returns the condition of each sentence.

        Raises:
            InputError: There is no sentence.
        """
        embedding = self.encoder(inputs)
        return embedding.word_by_word() if self.by_word else embedding.sentence()

    def null(self, count: int) -> Conditioning:
        """Returns the empty sentence `count` times (MLD's unconditional prompt)."""
        return self([""] * count)
