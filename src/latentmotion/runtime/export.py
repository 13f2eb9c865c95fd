"""Trained networks to ONNX graphs, which the inner ring runs without PyTorch.

Each graph has named inputs, and axes of any batch and any length.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.export import Dim

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.context import LeapEmbedding
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.leaps import Leap
from latentmotion.files import atomic_file
from latentmotion.vae.interface import MotionVAE

_BATCH, _TOKENS, _WORDS, _FRAMES = (
    Dim.DYNAMIC,
    Dim.DYNAMIC,
    Dim.DYNAMIC,
    Dim.DYNAMIC,
)


def export_denoiser(denoiser: Denoiser, latent_width: int, words_width: int, path: Path) -> None:
    """Writes a denoiser's graph: z, t, words, words_mask, mask → prediction.

    A distilled one has two more inputs, guidance and stride.
    """
    batch, tokens, words = 2, 7, 3
    inputs = {
        "z": torch.randn(batch, tokens, latent_width),
        "t": torch.rand(batch),
        "words": torch.randn(batch, words, words_width),
        "words_mask": torch.ones(batch, words, dtype=torch.bool),
        "mask": torch.ones(batch, tokens, dtype=torch.bool),
    }
    axes = {
        "z": {0: _BATCH, 1: _TOKENS},
        "t": {0: _BATCH},
        "words": {0: _BATCH, 1: _WORDS},
        "words_mask": {0: _BATCH, 1: _WORDS},
        "mask": {0: _BATCH, 1: _TOKENS},
    }
    graph = _DenoiserGraph(denoiser)
    if isinstance(denoiser.leaps, LeapEmbedding):
        graph = _StudentGraph(denoiser)
        inputs |= {"guidance": torch.rand(batch), "stride": torch.rand(batch)}
        axes |= {"guidance": {0: _BATCH}, "stride": {0: _BATCH}}
    _export(graph, inputs, axes, path)


def export_decoder(vae: MotionVAE, frames_per_token: int | None, path: Path) -> None:
    """Writes a VAE decoder's graph: latents, mask → normalized features."""
    batch, tokens = 2, 7
    frames = tokens * (frames_per_token or 4)
    inputs = {
        "latents": torch.randn(batch, tokens, vae.latent_width),
        "mask": torch.ones(batch, frames, dtype=torch.bool),
    }
    axes = {"latents": {0: _BATCH, 1: _TOKENS}, "mask": {0: _BATCH, 1: _FRAMES}}
    _export(_DecoderGraph(vae), inputs, axes, path)


class _DenoiserGraph(nn.Module):
    """The denoiser with plain tensors as inputs."""

    def __init__(self, denoiser: nn.Module) -> None:
        super().__init__()
        self.denoiser = denoiser

    def forward(
        self, z: Tensor, t: Tensor, words: Tensor, words_mask: Tensor, mask: Tensor
    ) -> Tensor:
        return self.denoiser(z, t, Conditioning(words, words_mask), mask)


class _StudentGraph(_DenoiserGraph):
    """A distilled denoiser, likewise."""

    def forward(  # one graph has two inputs more
        self,
        z: Tensor,
        t: Tensor,
        words: Tensor,
        words_mask: Tensor,
        mask: Tensor,
        guidance: Tensor,
        stride: Tensor,
    ) -> Tensor:
        leap = Leap(guidance, stride)
        return self.denoiser(z, t, Conditioning(words, words_mask), mask, leap)


class _DecoderGraph(nn.Module):
    """The decoder half of a VAE."""

    def __init__(self, vae: MotionVAE) -> None:
        super().__init__()
        self.vae = vae

    def forward(self, latents: Tensor, mask: Tensor) -> Tensor:
        return self.vae.decode(latents, mask)


def _export(
    network: nn.Module,
    inputs: Mapping[str, Tensor],
    axes: Mapping[str, Mapping[int, object]],
    path: Path,
) -> None:
    with atomic_file(path) as temporary, warnings.catch_warnings():
        # The exporter warns of its own internals; what it wrote is compared with eager in tests.
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        torch.onnx.export(
            network.eval(),
            kwargs=dict(inputs),
            f=temporary,
            input_names=list(inputs),
            dynamic_shapes=dict(axes),
            dynamo=True,
            external_data=False,
            verbose=False,
        )
