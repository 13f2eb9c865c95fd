"""MoMask's first stage (Guo et al. 2024) to a model folder: its residual VQ-VAE.

Only the networks of its published form are read: a quarter of the frame rate, ReLU, no
normalization, dilations that grow threefold. Its transformers over codes are not converted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import torch

from latentmotion.convert.mld import Origin, Weights, model_card, shape
from latentmotion.errors import InputError, ModelError
from latentmotion.model.config import QuantizedVAEConfig
from latentmotion.networks import checkpoint

# Shortest and longest motions of HumanML3D and KIT that it was trained on.
_FRAMES = (40, 196)

_CODEBOOK = re.compile(r"quantizer\.layers\.\d+\.codebook")


def is_momask(weights: Weights) -> bool:
    """Returns whether a file's weights are those of MoMask's first stage, by their names."""
    return "quantizer.layers.0.codebook" in weights


def first_stage(weights: Weights, path: Path, origin: Origin) -> checkpoint.FirstStageModel:
    """Returns the model of the weights of MoMask's first stage.

    Args:
        weights: All tensors of the file.
        path: The checkpoint, for the card and for error messages.
        origin: What the file does not state: the normalizer.

    Raises:
        ModelError: A weight is missing, unknown or of another shape.
        InputError: The normalizer is missing or does not fit, or another setting is given.
    """
    if origin != Origin(origin.normalizer):
        raise InputError(
            f"{path} is MoMask's first stage, whose only settings are --mean and --std; leave the "
            "others out"
        )
    books = [name for name in weights if _CODEBOOK.fullmatch(name)]
    books.sort(key=lambda name: int(name.split(".")[2]))
    if len({weights[name].shape for name in books}) > 1:
        raise ModelError(f"{path}: its codebooks differ in size")
    codes, channels = shape(weights, books[0])
    width, features, _ = shape(weights, "encoder.model.0.weight")
    depth = sum(name.startswith("encoder.model.2.1.model.") for name in weights) // 4
    config = QuantizedVAEConfig(
        features,
        width,
        channels,
        codes,
        len(books),
        dilations=tuple(3**n for n in reversed(range(depth))),
    )
    names = {
        f"{theirs}.{kind}": f"{ours}.{kind}"
        for theirs, ours in _names(depth)
        for kind in ("weight", "bias")
    }
    renamed = {
        names.get(name, name): weight.float()
        for name, weight in weights.items()
        if name not in books
    }
    renamed["codebooks"] = torch.stack([weights[name].float() for name in books])
    checkpoint.check_sizes(lambda: checkpoint.build(config), renamed, f"{path}, MoMask")
    vae = checkpoint.build(config)
    checkpoint.load_weights(vae, renamed, f"{path}, MoMask")
    card = model_card(path, config, None, origin)
    terms = "as its authors say (MoMask's code is MIT; the data behind it has terms of its own)"
    provenance = replace(card.provenance, license=terms)
    return checkpoint.FirstStageModel(replace(card, frames=_FRAMES, provenance=provenance), vae)


def _names(depth: int) -> Iterator[tuple[str, str]]:
    """Yields MoMask's names of layers and ours, for so many residual blocks at each rate."""
    last = 2 * depth + 4
    for network, ends in (("encoder", {0: 0, 4: last}), ("decoder", {0: 0, 4: last, 6: last + 1})):
        for theirs, ours in ends.items():
            yield f"{network}.model.{theirs}", f"{network}.{ours}.convolution"
        for rate in (0, 1):
            first, part = 2 + rate * (depth + 1), f"{network}.model.{2 + rate}"
            resampling = (".0", first) if network == "encoder" else (".2", first + depth)
            yield f"{part}{resampling[0]}", f"{network}.{resampling[1]}.convolution"
            blocks = (f"{part}.1", first + 1) if network == "encoder" else (f"{part}.0", first)
            for n in range(depth):
                theirs, ours = f"{blocks[0]}.model.{n}", f"{network}.{blocks[1] + n}"
                yield f"{theirs}.conv1", f"{ours}.dilated"
                yield f"{theirs}.conv2", f"{ours}.pointwise"
