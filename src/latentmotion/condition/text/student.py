"""The small text encoder that ships with a model; it knows which words it has learned."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tokenizers import Tokenizer

from latentmotion.condition.interface import TextEmbedding
from latentmotion.condition.text.graph import GraphTextEncoder, open_encoder, width_of
from latentmotion.condition.text.unknown_words import warn_of_unknown
from latentmotion.condition.text.vocabulary import split_words


@dataclass(frozen=True)
class StudentTextEncoder(GraphTextEncoder):
    """A distilled encoder, ready to use; its tokenizer is WordPiece, nothing is padded."""

    known_words: frozenset[str]
    """Words of several pieces that occurred in training."""

    @classmethod
    def load(cls, folder: str | Path, threads: int = 1) -> StudentTextEncoder:
        """Loads the encoder from a model's folder.

        Args:
            folder: Folder with `text_encoder.onnx` and `tokenizer.json`.
            threads: Threads of ONNX Runtime; a sentence is too short to gain from several.

        Raises:
            ModelError: A file is missing or damaged.
        """
        return open_encoder(Path(folder), threads, _student)

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns pooled embeddings of unit length and the states of the word pieces.

        Warns (`UnknownWordsWarning`) of words that neither are one piece nor occurred in
        training.

        Raises:
            InputError: There is no sentence.
        """
        warn_of_unknown(word for text in sentences for word in self.unknown_words(text))
        return super().__call__(sentences)

    def unknown_words(self, sentence: str) -> list[str]:
        """Returns the words of a sentence that the encoder can only guess from their pieces."""
        split = split_words(self.tokenizer, sentence)
        return [word for word in split if word not in self.known_words]


def load_text_encoder(folder: str | Path, threads: int = 1) -> GraphTextEncoder:
    """Loads the text encoder of a folder, whichever it is: the student's, or an exported CLIP.

    Args:
        folder: Folder with `text_encoder.onnx` and `tokenizer.json`.
        threads: Threads of ONNX Runtime.

    Raises:
        ModelError: A file is missing or damaged.
    """
    return open_encoder(Path(folder), threads, _any)


def _student(session: Any, tokenizer: Tokenizer, card: Mapping[str, str]) -> StudentTextEncoder:
    known = frozenset(json.loads(card["known_words"]))
    return StudentTextEncoder(card["name"], width_of(session), session, tokenizer, known)


def _any(session: Any, tokenizer: Tokenizer, card: Mapping[str, str]) -> GraphTextEncoder:
    if "known_words" in card:
        return _student(session, tokenizer, card)
    return GraphTextEncoder(card["name"], width_of(session), session, tokenizer)
