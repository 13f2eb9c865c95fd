"""The small text encoder that ships with a model: ONNX Runtime and a tokenizer, no PyTorch.

Sentences go through the graph one at a time: padding would only cost time, and so an embedding
does not depend on the company its sentence is in, not even in the last bit.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tokenizers import Tokenizer

from latentmotion.condition.interface import TextEmbedding, stack
from latentmotion.condition.text.vocabulary import split_words
from latentmotion.errors import InputError, ModelError

GRAPH_FILE = "text_encoder.onnx"
TOKENIZER_FILE = "tokenizer.json"


class UnknownWordsWarning(UserWarning):
    """A sentence has words the encoder never met; it reads them by their pieces."""


@dataclass(frozen=True)
class StudentTextEncoder:
    """A distilled encoder, ready to use. Immutable, so that one serves many threads."""

    name: str
    """Name and digest of the weights."""
    width: int
    """Numbers per vector."""
    session: Any
    """ONNX Runtime's session: tokens, mask → pooled, words."""
    tokenizer: Tokenizer
    """WordPiece, nothing padded."""
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
        graph, tokenizer = Path(folder) / GRAPH_FILE, Path(folder) / TOKENIZER_FILE
        for path in (graph, tokenizer):
            if not path.is_file():
                raise ModelError(
                    f"{path} is missing; a text encoder needs {GRAPH_FILE} and {TOKENIZER_FILE}: "
                    "copy the model's folder again or run latentmotion train text-encoder"
                )
        try:
            return cls._open(graph, Tokenizer.from_file(str(tokenizer)), threads)
        except Exception as error:  # onnxruntime and tokenizers have error classes of their own
            raise ModelError(f"{folder}: the text encoder cannot be loaded: {error}") from error

    @classmethod
    def _open(cls, graph: Path, tokenizer: Tokenizer, threads: int) -> StudentTextEncoder:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
        card = session.get_modelmeta().custom_metadata_map
        width = int(session.get_outputs()[0].shape[-1])
        known = frozenset(json.loads(card["known_words"]))
        return cls(card["name"], width, session, tokenizer, known)

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns pooled embeddings of unit length and the states of the word pieces.

        Warns with `UnknownWordsWarning` of words that neither are one piece nor occurred in
        training.

        Raises:
            InputError: There is no sentence.
        """
        if not sentences:
            raise InputError("no sentence to encode; give at least one")
        self._warn_of_unknown(sentences)
        return stack([self._encode(sentence) for sentence in sentences])

    def unknown_words(self, sentence: str) -> list[str]:
        """Returns the words of a sentence that the encoder can only guess from their pieces."""
        split = split_words(self.tokenizer, sentence)
        return [word for word in split if word not in self.known_words]

    def _encode(self, sentence: str) -> TextEmbedding:
        tokens = np.array([self.tokenizer.encode(sentence).ids], np.int64)
        mask = np.ones(tokens.shape, dtype=bool)
        pooled, words = self.session.run(None, {"tokens": tokens, "mask": mask})
        return TextEmbedding(pooled, words, mask)

    def _warn_of_unknown(self, sentences: Sequence[str]) -> None:
        words = dict.fromkeys(word for text in sentences for word in self.unknown_words(text))
        if words:
            named = ", ".join(repr(word) for word in words)
            warnings.warn(
                f"unknown to the text encoder, read by their pieces: {named}; "
                "another word for it may work better",
                UnknownWordsWarning,
                stacklevel=3,
            )
