"""Sentence-T5 (Ni et al. 2022) as sentence-transformers keeps it, the text encoder of MotionLCM.

    states of T5's encoder (1024 wide for -large) → dense layer without bias (768)

Their mean over the words, at unit length, is the sentence; since the layer is linear it may come
before the mean, and words have vectors of the same width. In the folder:

    config.json, weights, tokenizer          T5 as `transformers` keeps it
    2_Dense/config.json                      widths, activation (identity)
    2_Dense/model.safetensors, or pytorch_model.bin
"""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Int
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from latentmotion.errors import ModelError

FOLDER = "2_Dense"
"""Where the layer is kept."""

_WEIGHT, _BIAS = "linear.weight", "linear.bias"


class SentenceT5(nn.Module):
    """An encoder of T5 and the layer after it."""

    def __init__(self, encoder: nn.Module, dense: nn.Linear) -> None:
        super().__init__()
        self.encoder, self.dense = encoder, dense

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.dense.out_features

    def forward(
        self, input_ids: Int[Tensor, "batch words"], attention_mask: Int[Tensor, "batch words"]
    ) -> Float[Tensor, "batch words width"]:
        """Returns a vector of each word."""
        states = self.encoder(input_ids=input_ids, attention_mask=attention_mask)
        return self.dense(states.last_hidden_state)


def with_dense(encoder: Any, source: str) -> SentenceT5:
    """Puts the layer in a folder, or of a model of the hub, behind its encoder.

    Raises:
        ModelError: It is missing, damaged, or does not fit.
    """
    weights = _weights(source)
    dense, width = weights.get(_WEIGHT), encoder.config.d_model
    if dense is None or dense.ndim != 2 or dense.shape[1] != width or _BIAS in weights:
        raise ModelError(
            f"{source}/{FOLDER}: expected one weight {_WEIGHT!r} for {width} numbers, found "
            f"{ {name: tuple(w.shape) for name, w in weights.items()} }; is it sentence-T5?"
        )
    layer = nn.Linear(width, len(dense), bias=False)
    layer.load_state_dict({"weight": dense.float()})
    return SentenceT5(encoder, layer)


def _weights(source: str) -> dict[str, Tensor]:
    settings = _file(source, "config.json")
    path = _file(source, "model.safetensors") or _file(source, "pytorch_model.bin")
    if settings is None or path is None:
        raise ModelError(
            f"{source} lacks {FOLDER}/config.json and model.safetensors or pytorch_model.bin: "
            "expected the whole folder of sentence-t5, as sentence-transformers keeps it"
        )
    try:
        activation = json.loads(settings.read_text(encoding="utf-8"))["activation_function"]
        tensors = load_file(path) if path.suffix == ".safetensors" else _torch_file(path)
    except (OSError, ValueError, KeyError, RuntimeError, SafetensorError) as error:
        raise ModelError(f"{path.parent} is damaged: {error}; copy it again") from error
    if not str(activation).endswith("Identity"):
        raise ModelError(f"{settings}: activation {activation}, expected identity")
    return tensors


def _torch_file(path: Path) -> dict[str, Tensor]:
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise ValueError(f"it holds more than tensors ({error})") from error


def _file(source: str, name: str) -> Path | None:
    """Returns a file of the layer; from the hub it is fetched first."""
    from transformers.utils.hub import cached_file

    found = cached_file(source, f"{FOLDER}/{name}", _raise_exceptions_for_missing_entries=False)
    return Path(found) if found else None
