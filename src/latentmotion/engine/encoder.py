"""Text encoders: sentences to embeddings by an ONNX graph and a tokenizer, without PyTorch.

An embedding does not depend on the other sentences of a batch, not even in the last bit. Padding
would only cost time: the distilled encoder reads sentences of equal length together, any other one
at a time. If an encoder needs padding, as CLIP does to 77 tokens, its tokenizer's file says so.

Text caches: embeddings in memory or on disk, so that an encoder reads a sentence only once.

On disk, each file holds the embeddings of some sentences with a checksum. Files appear whole or not
at all, so processes may share the folder; a damaged file is computed again. A folder that cannot be
written costs time only.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import warnings
from collections import Counter, OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from latentmotion.arrays import unit
from latentmotion.diffusion.condition import TextEmbedding, TextEncoder, stack
from latentmotion.engine.session import PickledByFields, onnxruntime_session
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import text_encoder_files
from latentmotion.storage.files import atomic_file, sha256

# Sentences that the distilled encoder reads together at most, which bounds memory.
_TOGETHER = 32

# Sentences whose embeddings are kept, some 20 kB each.
_RECENT = 64


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
    while isinstance(encoder, AroundEncoder):
        encoder = encoder.encoder
    splits = getattr(encoder, "pieces", None)
    return splits(word) if splits else [word]


@dataclass(frozen=True)
class GraphTextEncoder:
    """An exported text encoder. Immutable, so that one serves many threads."""

    name: str  # Name that tells its embeddings from any other encoder's.
    width: int  # Numbers per vector.
    session: Any  # ONNX Runtime's session: tokens, mask → pooled, words.
    # Tokenizer of the package `tokenizers`, which truncates and pads as its file says.
    tokenizer: Any
    # For one motion a sentence is read for its length, clips, takes and scores.
    _recent: dict[tuple[int, ...], TextEmbedding] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns pooled embeddings and the states of the word pieces.

        Raises:
            InputError: There is no sentence.
        """
        if not sentences:
            raise InputError("no sentence to encode; give at least one")
        read: dict[str, TextEmbedding] = {}
        alike: dict[int, dict[str, tuple[int, ...]]] = {}
        for sentence in dict.fromkeys(sentences):
            encoding = self.tokenizer.encode(sentence)
            if encoding.overflowing:
                warn_of_length(sentence, len(encoding.ids))
            tokens = tuple(encoding.ids)
            recent = self._recent.get(tokens)
            if recent is not None:
                read[sentence] = recent
            else:
                alike.setdefault(len(tokens), {})[sentence] = tokens
        for pieces in alike.values():
            rows = self.read(np.array([*pieces.values()], np.int64))
            read.update(zip(pieces, rows, strict=True))
            if len(rows) <= _RECENT:
                if len(self._recent) + len(rows) > _RECENT:
                    self._recent.clear()
                self._recent.update(zip(pieces.values(), rows, strict=True))
        return stack([read[sentence] for sentence in sentences])

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

    known_words: frozenset[str]  # Words of several pieces that occurred in training.

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
        distinct = dict.fromkeys(sentences)  # several takes of one sentence ask for it again
        warn_of_unknown(word for text in distinct for word in self.unknown_words(text))
        return super().__call__(sentences)

    def unknown_words(self, sentence: str) -> list[str]:
        """Returns the words of a sentence that the encoder can only guess from their pieces."""
        split = split_words(self.tokenizer, sentence)
        return [word for word in split if word not in self.known_words]


@dataclass(frozen=True)
class LazyTextEncoder(PickledByFields):
    """A text encoder that is loaded when it is first needed."""

    folder: Path  # Folder with `text_encoder.onnx` and `tokenizer.json`.
    name: str  # The encoder's name.
    width: int  # Numbers per vector.

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


MOST_NAMED = 12  # Unknown words that a warning names.


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


MAX_PROMPTS = 1000  # Prompts that are kept for a user, some 20 kB each.

SENTENCES_PER_FILE = 512  # Sentences per file of a data set.


@dataclass(frozen=True, eq=False)
class AroundEncoder:
    """What is put around a text encoder has its name and width."""

    encoder: TextEncoder  # The encoder inside.

    @property
    def name(self) -> str:
        """The encoder's name."""
        return self.encoder.name

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.encoder.width


@dataclass(frozen=True, eq=False)
class MemoryCachedTextEncoder(AroundEncoder):
    """A text encoder that keeps embeddings in memory; threads may share it.

    New ones of a batch are read together; an embedding does not depend on the company.
    """

    most: int | None = None  # Sentences that are kept, those used last; None for all.
    _known: OrderedDict[str, TextEmbedding] = field(default_factory=OrderedDict, repr=False)
    _lock: Lock = field(default_factory=Lock, repr=False)

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns the embeddings of sentences.

        Raises:
            InputError: There is no sentence.
        """
        with self._lock:
            embeddings = {text: self._known[text] for text in sentences if text in self._known}
        new = [text for text in dict.fromkeys(sentences) if text not in embeddings]
        if new or not sentences:
            embeddings |= _rows_of(new, self.encoder(new))
        with self._lock:
            for text in sentences:
                self._known[text] = embeddings[text]
                self._known.move_to_end(text)
            while self.most is not None and len(self._known) > self.most:
                self._known.popitem(last=False)
        return stack([embeddings[text] for text in sentences])


@dataclass(frozen=True, eq=False)
class CachedTextEncoder(AroundEncoder):
    """A text encoder with a cache; its embeddings are those of the encoder inside.

    Without `max_prompts` the cache is that of a data set: files of many sentences, all of which
    are kept in memory, too. With `max_prompts` it is that of a user's prompts: each has a file of
    its own, and those unused for longest are deleted when there are too many.
    """

    folder: Path  # Folder of the cache, which several encoders may share.
    # Files of the encoder, if their content tells encoders apart; by default its name does.
    files: tuple[Path, ...] = ()
    max_prompts: int | None = None  # Maximum number of prompts that are kept on disk.
    _rows: dict[str, TextEmbedding] = field(default_factory=dict, init=False, repr=False)
    _files_read: set[Path] = field(default_factory=set, init=False, repr=False)

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns embeddings of sentences, without white space at their ends and runs of it.

        Raises:
            InputError: There is no sentence.
        """
        if not sentences:
            raise InputError("no sentence to encode; give at least one")
        texts = [" ".join(sentence.split()) for sentence in sentences]
        if self.max_prompts is not None:
            prompts: dict[str, TextEmbedding] = {}
            for text in dict.fromkeys(texts):  # a file each
                path = self._file([text])
                rows, unknown = _read(path)
                if text not in rows:
                    prompts[text] = self._computed([text])[text]
                    continue
                prompts[text] = rows[text]
                warn_of_unknown(unknown)
                with suppress(OSError):  # nothing may be written there
                    os.utime(path)
            return stack([prompts[text] for text in texts])
        for path in sorted(set(self._folder.glob("[!.]*.safetensors")) - self._files_read):
            self._files_read.add(path)
            self._rows.update(_read(path)[0])
        missing = [text for text in dict.fromkeys(texts) if text not in self._rows]
        for first in range(0, len(missing), SENTENCES_PER_FILE):
            self._rows.update(self._computed(missing[first : first + SENTENCES_PER_FILE]))
        return stack([self._rows[text] for text in texts])

    def _computed(self, texts: list[str]) -> dict[str, TextEmbedding]:
        """Returns embeddings of sentences by the encoder, and writes them into a file."""
        embedding, encoder, path = self.encoder(texts), self.encoder, self._file(texts)
        unknown: list[str] = []
        if isinstance(encoder, EncoderWithVocabulary):
            unknown = [word for text in texts for word in encoder.unknown_words(text)]
        arrays = {"pooled": embedding.pooled, "words": embedding.words, "mask": embedding.mask}
        metadata = {"sentences": json.dumps(texts), "unknown": json.dumps(unknown)}
        metadata["checksum"] = _checksum(arrays)
        with suppress(OSError, InputError):  # a full or read-only disk
            path.parent.mkdir(parents=True, exist_ok=True)
            with atomic_file(path) as temporary:
                save_file(arrays, temporary, metadata)
            self._files_read.add(path)
            self._delete_oldest()
        return _rows_of(texts, embedding)

    def _delete_oldest(self) -> None:
        """Deletes a tenth of the prompts, those unused for longest, if there are too many."""
        most = self.max_prompts
        paths = [] if most is None else list(self._folder.glob("[!.]*.safetensors"))
        if most is None or len(paths) <= most:
            return

        def last_use(path: Path) -> float:
            try:
                return path.stat().st_mtime
            except FileNotFoundError:  # another process deleted it
                return 0.0

        for path in sorted(paths, key=last_use)[: len(paths) - most + most // 10]:
            path.unlink(missing_ok=True)

    def _file(self, texts: list[str]) -> Path:
        key = json.dumps([self._version, texts] if self.files else texts)
        return self._folder / f"{_digest(key)}.safetensors"

    @cached_property
    def _version(self) -> str:
        return "".join(sha256(file) for file in self.files)

    @cached_property
    def _folder(self) -> Path:
        """The folder of this encoder's files; encoders with files share one, see `_version`."""
        if self.files:
            return self.folder
        readable = re.sub(r"[^A-Za-z0-9]+", "-", self.name).strip("-")[-40:]
        return self.folder / f"{readable}-{_digest(self.name)[:16]}"


def _read(path: Path) -> tuple[dict[str, TextEmbedding], list[str]]:
    """Returns the embeddings in a file and the unknown words; none if it is absent or damaged."""
    try:
        with safe_open(path, "numpy") as file:
            metadata = file.metadata()
            arrays = {name: file.get_tensor(name) for name in ("pooled", "words", "mask")}
        if metadata["checksum"] != _checksum(arrays):
            return {}, []
        rows = _rows_of(json.loads(metadata["sentences"]), TextEmbedding(**arrays))
        return rows, json.loads(metadata["unknown"])
    except (OSError, SafetensorError, KeyError, TypeError, ValueError):
        return {}, []


def _rows_of(texts: list[str], embedding: TextEmbedding) -> dict[str, TextEmbedding]:
    """Returns each sentence's embedding, without the padding that only longer ones need."""
    rows = {}
    for row, text in enumerate(texts):
        words = int(np.flatnonzero(embedding.mask[row]).max()) + 1
        rows[text] = TextEmbedding(
            embedding.pooled[row : row + 1].copy(),
            embedding.words[row : row + 1, :words].copy(),
            embedding.mask[row : row + 1, :words].copy(),
        )
    return rows


def _checksum(arrays: dict[str, np.ndarray]) -> str:
    content = (hashlib.sha256(array.tobytes()).hexdigest() for array in arrays.values())
    return _digest("".join(content))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
