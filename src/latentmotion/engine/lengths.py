"""Length model: quantiles of a motion's length from its sentence's pooled embedding.

A perceptron with a few hidden layers in NumPy, some 230,000 weights. It reads the embeddings of one
text encoder only, so its file is stored beside that encoder.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from latentmotion.engine.session import PickledByFields
from latentmotion.errors import ModelError
from latentmotion.storage.files import atomic_file

# Shares of motions that are shorter; the median is the usual length.
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)

_MOST_ARRAYS = 24
_SCALE = ".scale"  # Ends the name of the scales of a matrix in 8 bits.
_MAKE = "make it anew: latentmotion train length"

SHORTEST_USUAL = 1.6  # Minimum predicted length in seconds: a start and an end need time.

# Quantiles of the lengths that several takes of one sentence have in turn.
TAKE_QUANTILES = (0.5, 0.25, 0.5, 0.75)


def within(length: float, quantile: float, limits: tuple[float, float] | None) -> float:
    """Returns a predicted length within the usual limits of an act, in seconds.

    A prediction outside them says nothing about the act, so its quantile is one of the limits.
    """
    least, most = limits or (0.0, np.inf)
    if length > most:
        return max(least + quantile * (most - least), SHORTEST_USUAL)
    return max(length, least * (0.5 + max(quantile, 0.5)))


@dataclass(frozen=True)
class LengthModel:
    """Lengths of motions from embeddings of sentences: layers with relu between them."""

    encoder: str  # Name of the text encoder whose embeddings it reads.
    # Weights of the layers; the last has a row for each quantile.
    weights: tuple[Float[np.ndarray, "_ _"], ...]
    biases: tuple[Float[np.ndarray, " _"], ...]  # Their biases.

    def __call__(
        self, pooled: Float[np.ndarray, "sentences width"]
    ) -> Float[np.ndarray, "sentences quantiles"]:
        """Returns the lengths in seconds at `QUANTILES`, in rising order.

        One sentence at a time, so that a length does not depend on the batch; takes of one
        sentence are computed once.
        """
        *hidden, last = zip(self.weights, self.biases, strict=True)
        lengths: dict[bytes, np.ndarray] = {}
        for row in pooled:
            key, states = row.tobytes(), row
            if key not in lengths:
                for weight, bias in hidden:
                    states = np.maximum(weight @ states + bias, 0)
                lengths[key] = np.sort(last[0] @ states + last[1])
        return np.stack([lengths[row.tobytes()] for row in pooled])

    def usual(
        self, pooled: Float[np.ndarray, "sentences width"], quantiles: Sequence[float] = ()
    ) -> list[float]:
        """Returns a likely length of each sentence's motions in seconds, at least 1.6.

        Args:
            pooled: Embeddings of the sentences.
            quantiles: Which of `QUANTILES` each has; by default the median.
        """
        places = [QUANTILES.index(share) for share in quantiles or [0.5] * len(pooled)]
        return self(pooled)[np.arange(len(pooled)), places].clip(SHORTEST_USUAL).tolist()

    def write(self, path: Path) -> None:
        """Writes the model as safetensors, its weights in 8 bits with a scale for each row.

        Raises:
            InputError: The folder does not exist or cannot be written.
        """
        arrays = {f"{n}.bias": bias.astype(np.float16) for n, bias in enumerate(self.biases)}
        for layer, weight in enumerate(self.weights):
            scale = np.maximum(np.abs(weight).max(axis=1, keepdims=True) / 127, 1e-12)
            arrays[f"{layer}.weight"] = np.round(weight / scale).astype(np.int8)
            arrays[f"{layer}.weight{_SCALE}"] = scale.astype(np.float32)
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
                about, names = file.metadata() or {}, list(file.keys())
                if len(names) > _MOST_ARRAYS:
                    raise ValueError(f"{len(names)} arrays; expected at most {_MOST_ARRAYS}")
                arrays = {name: file.get_tensor(name).astype(np.float32) for name in names}
            for name in [name for name in names if name.endswith(_SCALE)]:  # 16 bits have none
                arrays[name.removesuffix(_SCALE)] *= arrays.pop(name)
            layers = range((len(arrays) + 1) // 2)
            weights, biases = (
                tuple(arrays[f"{layer}.{part}"] for layer in layers) for part in ("weight", "bias")
            )
            model = cls(about["encoder"], weights, biases)
            quantiles = json.loads(about["quantiles"])
        except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
            raise ModelError(f"{path} is damaged ({error}); {_MAKE}") from error
        # Each layer takes what the one before gives, and all numbers are finite.
        shapes = [weight.shape for weight in weights]
        fits = bool(shapes) and all(len(shape) == 2 for shape in shapes)
        fits = fits and [s[1] for s in shapes[1:]] == [s[0] for s in shapes[:-1]]
        fits = fits and shapes[-1][0] == len(QUANTILES) and quantiles == list(QUANTILES)
        fits = fits and [bias.shape for bias in biases] == [shape[:1] for shape in shapes]
        if not fits or not all(np.isfinite(array).all() for array in arrays.values()):
            raise ModelError(f"{path} is no model of lengths by {QUANTILES}; {_MAKE}")
        if encoder not in (None, model.encoder):
            raise ModelError(
                f"{path} reads the text encoder {model.encoder!r}, not {encoder!r}; {_MAKE}"
            )
        return model


@dataclass(frozen=True)
class LengthFile(PickledByFields):
    """A length model that is read when it is first needed."""

    path: Path  # The file.
    encoder: str | None  # Text encoder whose embeddings it must read.

    def usual(
        self, pooled: Float[np.ndarray, "sentences width"], quantiles: Sequence[float] = ()
    ) -> list[float]:
        """Returns a likely length of each sentence's motions, as `LengthModel` does.

        Raises:
            ModelError: The file is damaged or was made for another encoder.
        """
        return self._model.usual(pooled, quantiles)

    @cached_property
    def _model(self) -> LengthModel:
        return LengthModel.read(self.path, self.encoder)
