"""Embeddings kept on disk, so that training asks a slow encoder for each sentence only once."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from safetensors import safe_open
from safetensors.numpy import save_file

from latentmotion.condition.interface import TextEmbedding, TextEncoder, stack
from latentmotion.errors import InputError
from latentmotion.storage.files import atomic_file

AT_ONCE = 512
"""Sentences per file."""


class CachedTextEncoder:
    """A text encoder around a text encoder that remembers; its answers are the same.

    Files are only added, each whole or not at all, so several processes may share the folder.
    """

    def __init__(self, encoder: TextEncoder, folder: Path) -> None:
        self.encoder = encoder
        self.folder = folder
        self._rows: dict[str, TextEmbedding] = {}
        self._files: set[Path] = set()

    @property
    def name(self) -> str:
        """The encoder's name."""
        return self.encoder.name

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.encoder.width

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns embeddings, from disk where they are known.

        Raises:
            InputError: There is no sentence, or the folder cannot be written.
        """
        if not sentences:
            raise InputError("no sentence to encode; give at least one")
        self._read_new_files()
        missing = [text for text in dict.fromkeys(sentences) if text not in self._rows]
        for first in range(0, len(missing), AT_ONCE):
            self._compute(missing[first : first + AT_ONCE])
        return stack([self._rows[text] for text in sentences])

    def _compute(self, sentences: Sequence[str]) -> None:
        path = self._place() / f"{_digest(json.dumps(sentences))}.safetensors"
        path.parent.mkdir(parents=True, exist_ok=True)
        found = self.encoder(sentences)
        arrays = {"pooled": found.pooled, "words": found.words, "mask": found.mask}
        with atomic_file(path) as temporary:
            save_file(arrays, temporary, metadata={"sentences": json.dumps(sentences)})
        self._remember(path)

    def _read_new_files(self) -> None:
        for path in sorted(set(self._place().glob("[!.]*.safetensors")) - self._files):
            self._remember(path)

    def _remember(self, path: Path) -> None:
        with safe_open(path, "numpy") as file:
            sentences = json.loads(file.metadata()["sentences"])
            found = TextEmbedding(*(file.get_tensor(name) for name in ("pooled", "words", "mask")))
        self._rows |= {text: _row(found, place) for place, text in enumerate(sentences)}
        self._files.add(path)

    def _place(self) -> Path:
        readable = re.sub(r"[^A-Za-z0-9]+", "-", self.name).strip("-")[-40:]
        return self.folder / f"{readable}-{_digest(self.name)}"


def _row(embedding: TextEmbedding, place: int) -> TextEmbedding:
    """One sentence without the places that only longer ones need."""
    longest = int(np.flatnonzero(embedding.mask[place]).max()) + 1
    part = slice(place, place + 1)
    return TextEmbedding(
        embedding.pooled[part].copy(),
        embedding.words[part, :longest].copy(),
        embedding.mask[part, :longest].copy(),
    )


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
