"""Length model: quantiles of a motion's length from its sentence's pooled embedding.

A perceptron with one hidden layer in NumPy, some 75,000 weights: 30 µs per sentence. It reads the
embeddings of one text encoder only, so its file is stored beside that encoder.
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

QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)
"""Shares of motions that are shorter; the median is the usual length."""

_ARRAYS = ("hidden", "hidden_bias", "out", "out_bias")
_MAKE = "make it anew: latentmotion train length"

SHORTEST_USUAL = 1.6
"""Minimum predicted length in seconds: a start and an end need time."""


@dataclass(frozen=True)
class LengthModel:
    """Lengths of motions from embeddings of sentences: out · relu(hidden · x + bias) + bias."""

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

        One sentence at a time, so that a length does not depend on the batch.
        """
        lengths = []
        for row in pooled:
            hidden = np.maximum(self.hidden @ row + self.hidden_bias, 0)
            lengths.append(np.sort(self.out @ hidden + self.out_bias))
        return np.stack(lengths)

    def usual(self, pooled: Float[np.ndarray, "sentences width"]) -> list[float]:
        """Returns the median length of each sentence's motions in seconds, at least 1.6."""
        return self(pooled)[:, QUANTILES.index(0.5)].clip(SHORTEST_USUAL).tolist()

    def write(self, path: Path) -> None:
        """Writes the model as safetensors, in 16 bits.

        Raises:
            InputError: The folder does not exist or cannot be written.
        """
        arrays = {name: getattr(self, name).astype(np.float16) for name in _ARRAYS}
        about = {"encoder": self.encoder, "quantiles": json.dumps(QUANTILES)}
        with atomic_file(path) as temporary:
            save_file(arrays, temporary, about)

    @classmethod
    def read(cls, path: Path, encoder: str | None = None) -> LengthModel:
        """Reads a file that `write` wrote.

        Args:
            path: The file.
            encoder: Text encoder whose embeddings the model must read; None for any.

        Raises:
            ModelError: The file is missing or damaged, or its model reads another encoder.
        """
        if not path.is_file():
            raise ModelError(f"{path} is no file; make one: latentmotion train length")
        try:
            with safe_open(path, "numpy") as file:
                about = file.metadata() or {}
                arrays = {name: file.get_tensor(name).astype(np.float32) for name in _ARRAYS}
            model = cls(about["encoder"], **arrays)
            quantiles = json.loads(about["quantiles"])
        except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
            raise ModelError(f"{path} is damaged ({error}); {_MAKE}") from error
        shapes = [getattr(model, name).shape for name in _ARRAYS]
        finite = all(bool(np.isfinite(getattr(model, name)).all()) for name in _ARRAYS)
        fit = [len(shape) for shape in shapes] == [2, 1, 2, 1] and finite
        wide, count = shapes[0][0] if shapes[0] else 0, len(QUANTILES)
        fit = fit and shapes[1:] == [(wide,), (count, wide), (count,)]
        if not fit or quantiles != list(QUANTILES):
            raise ModelError(f"{path} is no model of lengths by {QUANTILES}; {_MAKE}")
        if encoder not in (None, model.encoder):
            raise ModelError(
                f"{path} reads the text encoder {model.encoder!r}, not {encoder!r}; {_MAKE}"
            )
        return model


@dataclass(frozen=True)
class LengthFile:
    """A length model that is read when it is first needed."""

    path: Path
    """The file."""
    encoder: str | None
    """Text encoder whose embeddings it must read."""

    def usual(self, pooled: Float[np.ndarray, "sentences width"]) -> list[float]:
        """Returns the median length in seconds of each sentence's motions.

        Raises:
            ModelError: The file is damaged or was made for another encoder.
        """
        return self._model.usual(pooled)

    @cached_property
    def _model(self) -> LengthModel:
        return LengthModel.read(self.path, self.encoder)
