"""How long the movement of a sentence takes: quantiles from the sentence's pooled embedding.

A perceptron with one hidden layer in NumPy, some 75,000 weights: 30 µs a sentence. It reads the
embeddings of one text encoder and no other, and so its file lies beside that encoder.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from latentmotion.errors import ModelError
from latentmotion.storage.files import atomic_file

LENGTHS_FILE = "lengths.safetensors"
"""Name in the folder of a model or text encoder."""

QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)
"""Shares of motions that are shorter; the middle one is the usual length."""

_ARRAYS = ("hidden", "hidden_bias", "out", "out_bias")


SHORTEST_USUAL = 1.6
"""Seconds that a motion has at least where nothing is said: a start and an end need time."""


@dataclass(frozen=True)
class LengthModel:
    """Embeddings of sentences to lengths of motions: out · relu(hidden · x + bias) + bias."""

    encoder: str
    """Name of the text encoder whose embeddings it reads."""
    hidden: Float[np.ndarray, "hidden width"]
    """Weights of the hidden layer."""
    hidden_bias: Float[np.ndarray, " hidden"]
    """Its bias."""
    out: Float[np.ndarray, "quantiles hidden"]
    """Weights of the last layer."""
    out_bias: Float[np.ndarray, " quantiles"]
    """Its bias."""

    def __call__(
        self, pooled: Float[np.ndarray, "sentences width"]
    ) -> Float[np.ndarray, "sentences quantiles"]:
        """Returns the lengths in seconds at `QUANTILES`, in rising order.

        One sentence at a time, so that a length does not depend on the company it is in.
        """
        return np.stack([self._quantiles(row) for row in pooled])

    def usual(self, pooled: Float[np.ndarray, "sentences width"]) -> list[float]:
        """Returns the median length in seconds of each sentence's motions, 1.6 at least."""
        return self(pooled)[:, QUANTILES.index(0.5)].clip(SHORTEST_USUAL).tolist()

    def write(self, path: Path) -> None:
        """Writes it as safetensors, in 16 bits.

        Raises:
            InputError: The folder does not exist or cannot be written.
        """
        arrays = {name: getattr(self, name).astype(np.float16) for name in _ARRAYS}
        about = {"encoder": self.encoder, "quantiles": json.dumps(QUANTILES)}
        with atomic_file(path) as temporary:
            save_file(arrays, temporary, about)

    @classmethod
    def read(cls, path: Path, encoder: str | None = None) -> LengthModel:
        """Reads what `write` wrote.

        Args:
            path: The file.
            encoder: The text encoder whose embeddings it must read; any, where None.

        Raises:
            ModelError: It is missing or damaged, or was made for another encoder.
        """
        if not path.is_file():
            raise ModelError(f"{path} is no file; make one: latentmotion train length")
        try:
            with safe_open(path, "numpy") as file:
                about = file.metadata() or {}
                arrays = {name: file.get_tensor(name).astype(np.float32) for name in _ARRAYS}
            model = cls(about["encoder"], **arrays)
            fit = json.loads(about["quantiles"]) == list(QUANTILES) and _fit_together(model)
        except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
            raise ModelError(f"{path} is damaged ({error}); {_MAKE}") from error
        if not fit:
            raise ModelError(f"{path} is no model of lengths by {QUANTILES}; {_MAKE}")
        if encoder not in (None, model.encoder):
            raise ModelError(
                f"{path} reads the text encoder {model.encoder!r}, not {encoder!r}; {_MAKE}"
            )
        return model

    def _quantiles(self, row: Float[np.ndarray, " width"]) -> Float[np.ndarray, " quantiles"]:
        hidden = np.maximum(self.hidden @ row + self.hidden_bias, 0)
        return np.sort(self.out @ hidden + self.out_bias)


@dataclass(frozen=True)
class LengthFile:
    """A model of lengths that is read when it is first needed."""

    path: Path
    """The file."""
    encoder: str | None
    """The text encoder that it shall fit."""

    def usual(self, pooled: Float[np.ndarray, "sentences width"]) -> list[float]:
        """Returns the median length in seconds of each sentence's motions.

        Raises:
            ModelError: The file is damaged or was made for another encoder.
        """
        return self._model.usual(pooled)

    @cached_property
    def _model(self) -> LengthModel:
        return LengthModel.read(self.path, self.encoder)


_MAKE = "make it anew: latentmotion train length"


def _fit_together(model: LengthModel) -> bool:
    shapes = [getattr(model, name).shape for name in _ARRAYS]
    if [len(shape) for shape in shapes] != [2, 1, 2, 1]:
        return False
    finite = all(bool(np.isfinite(getattr(model, name)).all()) for name in _ARRAYS)
    wide, count = shapes[0][0], len(QUANTILES)
    return finite and shapes[1:] == [(wide,), (count, wide), (count,)]
