"""Text encoders: sentences to embeddings by an ONNX graph and a tokenizer, without PyTorch.

An embedding does not depend on the other sentences of a batch, not even in the last bit. Padding
would only cost time: the distilled encoder reads sentences of equal length together, any other one
at a time. If an encoder needs padding, as CLIP does to 77 tokens, its tokenizer's file says so.
"""

from __future__ import annotations

import json
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int

from latentmotion.arrays import unit
from latentmotion.condition import TextEmbedding, TextEncoder, stack
from latentmotion.engine.session import PickledByFields, onnxruntime_session
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import text_encoder_files

# Sentences that the distilled encoder reads together at most, which bounds memory.
_TOGETHER = 32


class UnknownWordsWarning(UserWarning):
    """A sentence has words that the text encoder never met; it reads them by their pieces."""


class LongSentenceWarning(UserWarning):
    """A sentence is longer than the text encoder reads; its end is left out."""


@runtime_checkable
class EncoderWithVocabulary(TextEncoder, Protocol):
    """A text encoder that can say which words of a sentence it does not know."""

    def unknown_words(self, sentence: str) -> list[str]:
        """Returns the words of a sentence that the encoder can only guess."""
        ...


def pieces(encoder: TextEncoder, word: str) -> list[str]:
    """Returns the pieces that an encoder reads a word in; the word itself if it has no pieces.

    A frequent English word is one piece.
    """
    splits = getattr(encoder, "pieces", None)
    return splits(word) if splits else [word]


@dataclass(frozen=True)
class GraphTextEncoder:
    """An exported text encoder. Immutable, so that one serves many threads."""

    name: str
    """Name that tells its embeddings from any other encoder's."""
    width: int
    """Numbers per vector."""
    session: Any
    """ONNX Runtime's session: tokens, mask → pooled, words."""
    tokenizer: Any
    """Tokenizer of the package `tokenizers`, which truncates and pads as its file says."""

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns pooled embeddings and the states of the word pieces.

        Raises:
            InputError: There is no sentence.
        """
        if not sentences:
            raise InputError("no sentence to encode; give at least one")
        alike: dict[int, dict[str, list[int]]] = {}
        for sentence in dict.fromkeys(sentences):
            encoding = self.tokenizer.encode(sentence)
            if encoding.overflowing:
                warn_of_length(sentence, len(encoding.ids))
            alike.setdefault(len(encoding.ids), {})[sentence] = encoding.ids
        embeddings: dict[str, TextEmbedding] = {}
        for pieces in alike.values():
            rows = self.read(np.array([*pieces.values()], np.int64))
            embeddings.update(zip(pieces, rows, strict=True))
        return stack([embeddings[sentence] for sentence in sentences])

    def read(self, tokens: Int[np.ndarray, "batch words"]) -> list[TextEmbedding]:
        """Returns the embedding of each sentence of word pieces, all of one length."""
        return [TextEmbedding(*self._run(row[None])) for row in tokens]

    def _run(self, tokens: Int[np.ndarray, "batch words"]) -> tuple[Any, Any, Any]:
        mask = np.ones(tokens.shape, dtype=bool)
        try:
            return *self.session.run(None, {"tokens": tokens, "mask": mask}), mask
        except Exception as error:  # ONNX Runtime has error classes of its own
            raise ModelError(
                f"the text encoder {self.name!r} cannot read word pieces up to {tokens.max()} of "
                f"its tokenizer: {str(error).splitlines()[0]:.200}; the two do not belong together"
            ) from error

    def unknown_words(self, sentence: str) -> list[str]:
        """Returns no words: this encoder does not tell known words from others."""
        return []

    def pieces(self, word: str) -> list[str]:
        """Returns the pieces that a word is read in."""
        return self.tokenizer.encode(word, add_special_tokens=False).tokens


@dataclass(frozen=True)
class StudentTextEncoder(GraphTextEncoder):
    """The distilled text encoder, with a WordPiece tokenizer; its sentences are not padded."""

    known_words: frozenset[str]
    """Words of several pieces that occurred in training."""

    def read(self, tokens: Int[np.ndarray, "batch words"]) -> list[TextEmbedding]:
        """Returns the embedding of each sentence; many go through the graph together.

        Rows of the graph's words do not depend on one another. Its pooled vectors do in the last
        bit, so they are computed here: the mean of the words, at unit length.
        """
        embeddings: list[TextEmbedding] = []
        for first in range(0, len(tokens), _TOGETHER):
            _, words, mask = self._run(tokens[first : first + _TOGETHER])
            rows = (slice(row, row + 1) for row in range(len(words)))
            embeddings += [TextEmbedding(unit(words[r].mean(1)), words[r], mask[r]) for r in rows]
        return embeddings

    @classmethod
    def load(cls, folder: str | Path, threads: int = 1) -> StudentTextEncoder:
        """Loads the encoder from a model folder.

        Args:
            folder: Folder with `text_encoder.onnx` and `tokenizer.json`.
            threads: Threads of ONNX Runtime; a sentence is too short to gain from several.

        Raises:
            ModelError: A file is missing or damaged, or is another encoder's.
        """
        encoder = load_text_encoder(folder, threads)
        if not isinstance(encoder, StudentTextEncoder):
            raise ModelError(
                f"{folder}: the text encoder cannot be loaded: it is no distilled one, as its "
                "graph lists no known words"
            )
        return encoder

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns pooled embeddings of unit length and the states of the word pieces.

        Warns (`UnknownWordsWarning`) of words that are not one piece and did not occur in
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


@dataclass(frozen=True)
class LazyTextEncoder(PickledByFields):
    """A text encoder that is loaded when it is first needed."""

    folder: Path
    """Folder with `text_encoder.onnx` and `tokenizer.json`."""
    name: str
    """The encoder's name."""
    width: int
    """Numbers per vector."""

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns the embeddings of the sentences.

        Raises:
            InputError: There is no sentence.
            ModelError: A file of the encoder is missing or damaged.
        """
        return self._encoder(sentences)

    def unknown_words(self, sentence: str) -> list[str]:
        """Returns the words of a sentence that the encoder can only guess."""
        return self._encoder.unknown_words(sentence)

    def pieces(self, word: str) -> list[str]:
        """Returns the pieces that a word is read in."""
        return self._encoder.pieces(word)

    @cached_property
    def _encoder(self) -> GraphTextEncoder:
        return load_text_encoder(self.folder)


def load_text_encoder(folder: str | Path, threads: int = 1) -> GraphTextEncoder:
    """Loads the text encoder of a folder: a distilled one, or an exported CLIP or the like.

    Args:
        folder: Folder with `text_encoder.onnx` and `tokenizer.json`.
        threads: Threads of ONNX Runtime.

    Raises:
        ModelError: A file is missing or damaged.
    """
    graph, tokenizer = text_encoder_files(Path(folder))
    # Imported only here, since cached prompts need no tokenizer.
    from tokenizers import Tokenizer

    try:
        session = onnxruntime_session(graph, threads)
        card = session.get_modelmeta().custom_metadata_map
        width = int(session.get_outputs()[0].shape[-1])
        fields = card["name"], width, session, Tokenizer.from_file(str(tokenizer))
        if "known_words" not in card:
            return GraphTextEncoder(*fields)
        return StudentTextEncoder(*fields, frozenset(json.loads(card["known_words"])))
    except Exception as error:  # onnxruntime and tokenizers have error classes of their own
        raise ModelError(f"{folder}: the text encoder cannot be loaded: {error}") from error


MOST_NAMED = 12
"""Unknown words that a warning names."""


_SILENT = ContextVar("silent", default=False)


@contextmanager
def silent_of_unknown() -> Iterator[None]:
    """Keeps this thread from warning of unknown words; filters of warnings are the process's."""
    token = _SILENT.set(True)
    try:
        yield
    finally:
        _SILENT.reset(token)


def warn_of_unknown(words: Iterable[str]) -> None:
    """Warns of the words, each named once, if there are any."""
    unknown = [] if _SILENT.get() else list(dict.fromkeys(words))
    shown = [word if len(word) <= 40 else f"{word[:40]}…" for word in unknown[:MOST_NAMED]]
    if shown:
        named = ", ".join(map(repr, shown))
        named += f" and {len(unknown) - len(shown)} more" if len(unknown) > len(shown) else ""
        warnings.warn(
            f"unknown to the text encoder, read by their pieces: {named}; "
            "another English word may work better",
            UnknownWordsWarning,
            stacklevel=4,
        )


def warn_of_length(sentence: str, pieces: int) -> None:
    """Warns that the end of a sentence was not read."""
    shown = sentence if len(sentence) <= 60 else f"{sentence[:60]}…"
    warnings.warn(
        f"{shown!r} is longer than the {pieces} word pieces that the text encoder reads; the rest "
        "is left out. A shorter sentence works better; for one act after another see --timeline",
        LongSentenceWarning,
        stacklevel=4,
    )


def split_words(tokenizer: Any, sentence: str) -> list[str]:
    """Returns the words of a sentence that are several pieces, or no known piece at all.

    Args:
        tokenizer: A WordPiece tokenizer.
        sentence: The sentence.
    """
    encoding = tokenizer.encode(sentence, add_special_tokens=False)
    pieces = Counter(encoding.word_ids)
    spans = {
        (word, encoding.word_to_chars(word))
        for word, token in zip(encoding.word_ids, encoding.tokens, strict=True)
        if word is not None and (pieces[word] > 1 or token == "[UNK]")
    }
    return [sentence[slice(*span)].lower() for _, span in sorted(spans) if span]
