"""Text caches: embeddings in memory or on disk, so that an encoder reads a sentence only once.

On disk, each file holds the embeddings of some sentences with a checksum. Files appear whole or not
at all, so processes may share the folder; a damaged file is computed again. A folder that cannot be
written costs time only.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Lock

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from latentmotion.condition import TextEmbedding, TextEncoder, stack
from latentmotion.errors import InputError
from latentmotion.storage.files import atomic_file, sha256
from latentmotion.text.encoder import EncoderWithVocabulary, pieces, warn_of_unknown

MAX_PROMPTS = 1000
"""Prompts that are kept for a user, some 20 kB each."""

SENTENCES_PER_FILE = 512
"""Sentences per file of a data set."""


@dataclass(frozen=True, eq=False)
class _Cached:
    """An encoder with a cache looks like the encoder inside."""

    encoder: TextEncoder
    """The encoder inside; not used for known sentences."""

    @property
    def name(self) -> str:
        """The encoder's name."""
        return self.encoder.name

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.encoder.width

    def pieces(self, word: str) -> list[str]:
        """Returns the pieces that a word is read in; the word itself if the encoder has none."""
        return pieces(self.encoder, word)


@dataclass(frozen=True, eq=False)
class MemoryCachedTextEncoder(_Cached):
    """A text encoder that keeps embeddings in memory; threads may share it.

    New ones of a batch are read together; an embedding does not depend on the company.
    """

    most: int | None = None
    """Sentences that are kept, those used last; None for all."""
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
class CachedTextEncoder(_Cached):
    """A text encoder with a cache; its embeddings are those of the encoder inside.

    Without `max_prompts` the cache is that of a data set: files of many sentences, all of which
    are kept in memory, too. With `max_prompts` it is that of a user's prompts: each has a file of
    its own, and those unused for longest are deleted when there are too many.
    """

    folder: Path
    """Folder of the cache, which several encoders may share."""
    files: tuple[Path, ...] = ()
    """Files of the encoder, if their content tells encoders apart; by default its name does."""
    max_prompts: int | None = None
    """Maximum number of prompts that are kept on disk."""
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
