"""Captions → one vector per word: the T2M code's GloVe vectors, or a text encoder's states."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.arrays import prefix_mask
from latentmotion.condition.interface import TextEncoder
from latentmotion.condition.text.unknown_words import UnknownWordsWarning
from latentmotion.data.clip import Caption
from latentmotion.evaluation.extractors.tokens import (
    OTHER,
    PARTS_OF_SPEECH,
    Token,
    base_forms,
    class_of,
    tokens_of,
)

UNKNOWN = "unk"
"""The word that stands for all that have no vector."""


@dataclass(frozen=True)
class Sentences:
    """What the sentence network reads."""

    words: Float[np.ndarray, "batch words width"]
    """One vector per word, zero where there is none."""
    parts: Int[np.ndarray, "batch words"]
    """Number of each word's part of speech."""
    mask: Bool[np.ndarray, "batch words"]
    """True on real words."""


@runtime_checkable
class WordVectors(Protocol):
    """Captions to the vectors of their words."""

    @property
    def name(self) -> str:
        """What distinguishes these vectors from any other's."""
        ...

    @property
    def width(self) -> int:
        """Numbers per vector."""
        ...

    def __call__(self, captions: Sequence[Caption]) -> Sentences:
        """Returns the words of at least one caption."""
        ...


@dataclass(frozen=True, eq=False)
class GloveWords:
    """A table of words, as the T2M evaluator uses it; `unk`, `sos` and `eos` are among them."""

    words: tuple[str, ...]
    """The words."""
    vectors: Float[np.ndarray, "words width"]
    """The vector of each."""

    @property
    def name(self) -> str:
        """`glove` and a digest of the vectors."""
        return f"glove {hashlib.sha256(self.vectors.tobytes()).hexdigest()[:16]}"

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.vectors.shape[1]

    def __call__(self, captions: Sequence[Caption]) -> Sentences:
        """Returns the words of captions; one without a vector is `unk` of class OTHER."""
        rows = [[self._known(token) for token in tokens_of(caption)] for caption in captions]
        numbers = [np.array([self._numbers[token.word] for token in row]) for row in rows]
        parts = [np.array([class_of(token) for token in row]) for row in rows]
        return fill([self.vectors[row] for row in numbers], parts)

    def _known(self, token: Token) -> Token:
        forms = [token.word] if token.tagged else base_forms(token.word)
        known = next((form for form in forms if form in self._numbers), None)
        return Token(known, token.part) if known else Token(UNKNOWN, OTHER)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {word: number for number, word in enumerate(self.words)}


@dataclass(frozen=True, eq=False)
class EncodedWords:
    """The states of a text encoder's word pieces, which know their sentence; no parts of speech."""

    encoder: TextEncoder
    """Sentences to states."""

    @property
    def name(self) -> str:
        """The encoder's name."""
        return self.encoder.name

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.encoder.width

    def __call__(self, captions: Sequence[Caption]) -> Sentences:
        """Returns the word pieces of captions."""
        with warnings.catch_warnings():
            # Misspelled captions of a data set are not the user's.
            warnings.simplefilter("ignore", UnknownWordsWarning)
            found = self.encoder([caption.text for caption in captions])
        rows = [words[mask] for words, mask in zip(found.words, found.mask, strict=True)]
        other = PARTS_OF_SPEECH.index(OTHER)
        return fill(rows, [np.full(len(row), other) for row in rows])


def fill(
    rows: Sequence[Float[np.ndarray, "_ width"]], parts: Sequence[Int[np.ndarray, " _"]]
) -> Sentences:
    """Fills sentences up with zeros to the longest."""
    mask = prefix_mask([len(row) for row in rows])
    words = np.zeros((*mask.shape, rows[0].shape[1]), np.float32)
    classes = np.zeros(mask.shape, np.int64)
    words[mask], classes[mask] = np.concatenate(rows), np.concatenate(parts)
    return Sentences(words, classes, mask)
