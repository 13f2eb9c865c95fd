"""Trained networks to ONNX graphs, which the inner ring runs without PyTorch.

Each graph has named inputs, and axes of any batch and any length. A fused sampler is a graph of
all that follows the condition: few steps unrolled, un-normalization and decoder in one.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor, nn

from latentmotion.checkpoint import LatentModel
from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.guidance import GuidanceAsInput
from latentmotion.diffusion.leaps import Leap
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.errors import ModelError
from latentmotion.feature_decoder import FeatureDecoder
from latentmotion.model.config import Sampling
from latentmotion.pipeline import features_from_noise, sampler_of
from latentmotion.representation.normalizer import Scale
from latentmotion.runtime.backend import Batch
from latentmotion.tracing import trace
from latentmotion.vae.interface import MotionVAE

_BATCH, _TOKENS, _WORDS = 2, 7, 3
"""Sizes of the examples that graphs are traced with; all of them stay free."""


def export_denoiser(denoiser: Denoiser, latent_width: int, words_width: int, path: Path) -> None:
    """Writes a denoiser's graph: z, t, words, words_mask, mask → prediction.

    A distilled one has two more inputs, guidance and stride.
    """
    told = denoiser.further_inputs
    graph = _StudentGraph(denoiser) if told else _DenoiserGraph(denoiser)
    inputs = {
        "z": torch.randn(_BATCH, _TOKENS, latent_width),
        "t": torch.rand(_BATCH),
        **_condition(words_width),
        "mask": torch.ones(_BATCH, _TOKENS, dtype=torch.bool),
        **{name: torch.rand(_BATCH) for name in told},
    }
    trace(graph, inputs, _free(inputs), path)


def export_decoder(vae: MotionVAE, frames_per_token: int | None, path: Path) -> None:
    """Writes a VAE decoder's graph: latents, mask → normalized features."""
    inputs = {
        "latents": torch.randn(_BATCH, _TOKENS, vae.latent_width),
        "mask": _frames(frames_per_token),
    }
    trace(_DecoderGraph(vae), inputs, _free(inputs), path)


def export_fused_sampler(model: LatentModel, steps: int, path: Path) -> None:
    """Writes a distilled model's graph of the whole way in so many steps.

    noise, words, words_mask, mask, frames, guidance → features in their own units.
    """
    card = model.card
    inputs = {
        "noise": torch.randn(_BATCH, _TOKENS, card.latents.width),
        **_condition(card.trained_denoiser.condition_width),
        "mask": torch.ones(_BATCH, _TOKENS, dtype=torch.bool),
        "frames": _frames(card.latents.frames_per_token),
        "guidance": torch.rand(_BATCH),
    }
    trace(FusedSampler(model, steps), inputs, _free(inputs), path)


class FusedSampler(nn.Module):
    """The pipeline's way from noise to features as one network.

    Args:
        model: A distilled model.
        steps: How many of its leaps lead all the way.

    Raises:
        ModelError: The model is not distilled.
    """

    def __init__(self, model: LatentModel, steps: int) -> None:
        super().__init__()
        self.card = card = model.card
        if card.leaps is None:
            raise ModelError(f"model {card.name!r} is not distilled, so no few steps are its way")
        self.denoiser, self.vae = model.denoiser, model.vae
        self.steps = steps
        self.sampler = sampler_of(card, Sampling(steps, sampler="ddim"))
        self.latents = _Scale(card.latents.mean, card.latents.std)
        self.features = _Scale(card.normalizer_mean, card.normalizer_std)

    def forward(
        self,
        noise: Tensor,
        words: Tensor,
        words_mask: Tensor,
        mask: Tensor,
        frames: Tensor,
        guidance: Tensor,
    ) -> Tensor:
        """Returns features in their own units, (batch, frames, features)."""
        batch, no_more = Batch(noise, mask, words, words_mask, frames), SeededNoise([])
        guided = GuidanceAsInput(self.denoiser, guidance, self.steps)
        decoder = FeatureDecoder(self.vae.decode, self.latents.scale, self.features.scale)
        return features_from_noise(batch, guided, self.sampler, self.steps, no_more, decoder)


class _Scale(nn.Module):
    """A scale whose numbers are a part of the graph."""

    mean: Tensor
    std: Tensor

    def __init__(self, mean: Sequence[float], std: Sequence[float]) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor(mean))
        self.register_buffer("std", torch.tensor(std))

    @property
    def scale(self) -> Scale:
        """What the pipeline computes with."""
        return Scale(self.mean, self.std)


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


def _condition(width: int) -> dict[str, Tensor]:
    real = torch.ones(_BATCH, _WORDS, dtype=torch.bool)
    return {"words": torch.randn(_BATCH, _WORDS, width), "words_mask": real}


def _frames(per_token: int | None) -> Tensor:
    return torch.ones(_BATCH, _TOKENS * (per_token or 4), dtype=torch.bool)


def _free(inputs: dict[str, Tensor]) -> dict[str, range]:
    """Returns the axes of every input but the last of vectors: batch and length."""
    return {name: range(min(value.ndim, 2)) for name, value in inputs.items()}
