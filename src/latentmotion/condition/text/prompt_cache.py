"""What a text encoder said of prompts, kept on disk: a known prompt needs no encoder at all.

One small file per prompt, named by the hash of the encoder's files and the prompt. Files appear
whole or not at all, so processes may share the folder; one that is damaged is made again, and
those unused for longest go when there are too many. A folder that cannot be written costs time
only.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from latentmotion.condition.interface import TextEmbedding, TextEncoder, stack
from latentmotion.condition.text.unknown_words import warn_of_unknown
from latentmotion.errors import InputError
from latentmotion.storage.files import atomic_file, sha256

MOST = 1000
"""Prompts that are kept, some 20 kB each."""


class KnowingEncoder(TextEncoder, Protocol):
    """A text encoder that knows which words it never met."""

    def unknown_words(self, sentence: str) -> list[str]:
        """Returns the words of a sentence that it can only guess."""
        ...


@dataclass(frozen=True)
class RememberingTextEncoder:
    """A text encoder around a text encoder, which is opened when a prompt is new."""

    files: tuple[Path, ...]
    """All that the encoder's answers depend on."""
    open: Callable[[], KnowingEncoder]
    """Opens the encoder."""
    folder: Path
    """Where answers are kept."""
    most: int = MOST
    """Answers that are kept."""

    @property
    def name(self) -> str:
        """The encoder's name."""
        return self._encoder.name

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self._encoder.width

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns embeddings of the sentences, white space at their ends and runs of it left out.

        Raises:
            InputError: There is no sentence.
        """
        if not sentences:
            raise InputError("no sentence to encode; give at least one")
        prompts = [" ".join(sentence.split()) for sentence in sentences]
        found = {prompt: self._answer(prompt) for prompt in dict.fromkeys(prompts)}
        return stack([found[prompt] for prompt in prompts])

    def _answer(self, prompt: str) -> TextEmbedding:
        path = self.folder / f"{_digest(self._version + prompt)}.safetensors"
        kept = _read(path)
        if kept is None:
            answer = self._encoder([prompt])
            self._keep(path, answer, self._encoder.unknown_words(prompt))
            return answer
        answer, unknown = kept
        warn_of_unknown(unknown)
        return answer

    def _keep(self, path: Path, answer: TextEmbedding, unknown: list[str]) -> None:
        arrays = {"pooled": answer.pooled, "words": answer.words, "mask": answer.mask}
        about = {"unknown": json.dumps(unknown), "check": _check(arrays)}
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with atomic_file(path) as temporary:
                save_file(arrays, temporary, about)
            _forget(self.folder, self.most)
        except (OSError, InputError):
            return

    @cached_property
    def _encoder(self) -> KnowingEncoder:
        return self.open()

    @cached_property
    def _version(self) -> str:
        return "".join(sha256(file) for file in self.files)


def _read(path: Path) -> tuple[TextEmbedding, list[str]] | None:
    """Returns an answer and the words that were unknown; None where there is none, or no more."""
    try:
        with safe_open(path, "numpy") as file:
            about = file.metadata()
            arrays = {name: file.get_tensor(name) for name in ("pooled", "words", "mask")}
        if about["check"] != _check(arrays):
            return None
        with suppress(OSError):  # nothing may be written there
            os.utime(path)
        return TextEmbedding(**arrays), json.loads(about["unknown"])
    except (OSError, SafetensorError, KeyError, TypeError, ValueError):
        return None


def _forget(folder: Path, most: int) -> None:
    """Deletes a tenth of the answers, those unused for longest, where there are too many."""
    kept = list(folder.glob("[!.]*.safetensors"))
    if len(kept) <= most:
        return
    for path in sorted(kept, key=_last_use)[: len(kept) - most + most // 10]:
        path.unlink(missing_ok=True)


def _last_use(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:  # another process deleted it
        return 0.0


def _check(arrays: dict[str, np.ndarray]) -> str:
    return _digest(
        "".join(hashlib.sha256(array.tobytes()).hexdigest() for array in arrays.values())
    )


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
