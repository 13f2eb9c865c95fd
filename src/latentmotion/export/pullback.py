"""The decoder's pullback as an ONNX graph: what directing a motion needs beside its decoder."""

from __future__ import annotations

from pathlib import Path

import torch

from latentmotion.engine.session import open_session
from latentmotion.export.onnx import trace
from latentmotion.model.config import STRIDE
from latentmotion.networks.vae.convolutional import Pullback
from latentmotion.networks.vae.interface import MotionVAE

_TOKENS, _ROWS, _FEATURES = 7, 3, 67
"""Sizes of the example that the graph is traced with; all of them stay free."""

PULLBACK_TOLERANCE = 1e-5
"""Largest difference between graph and automatic differentiation, relative to the largest value."""


def export_pullback(vae: MotionVAE, path: Path) -> None:
    """Writes the graph of a decoder of convolutions: latents, mask, gradient → their gradient."""
    inputs = example(vae.latent_width, _TOKENS, _ROWS, _FEATURES)
    free = {"latents": (1,), "mask": (1,), "gradient": (0, 1, 2)}
    trace(Pullback(vae), inputs, path, free=free)


def pullback_error(vae: MotionVAE, graph: Path) -> float:
    """Returns how far a graph is from automatic differentiation, relative to the largest value."""
    inputs = example(vae.latent_width, _TOKENS + 2, _ROWS + 1, _FEATURES)
    rows = len(inputs["gradient"])
    z = inputs["latents"].repeat(rows, 1, 1).requires_grad_(True)
    features = vae.decode(z, inputs["mask"].expand(rows, -1))[..., :_FEATURES]
    (expected,) = torch.autograd.grad(features, z, inputs["gradient"])
    session = open_session(graph, "onnxruntime")
    found = session(**{name: tensor.numpy() for name, tensor in inputs.items()})
    return float((torch.from_numpy(found) - expected).abs().max() / expected.abs().max())


def example(width: int, tokens: int, rows: int, features: int) -> dict[str, torch.Tensor]:
    """Returns inputs of a pullback."""
    frames = tokens * STRIDE
    return {
        "latents": torch.randn(1, tokens, width),
        "mask": torch.ones(1, frames, dtype=torch.bool),
        "gradient": torch.randn(rows, frames, features),
    }
