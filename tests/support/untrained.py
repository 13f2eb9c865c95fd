"""Model folders' parts without training: small networks and the card of a model."""

from __future__ import annotations

from dataclasses import replace

import torch

from latentmotion.diffusion.condition import TextTask
from latentmotion.diffusion.parametrization import Epsilon
from latentmotion.diffusion.schedule import ScaledLinear
from latentmotion.model.card import ModelCard
from latentmotion.model.config import (
    DenoiserConfig,
    IdentityVAEConfig,
    LatentSpace,
    Sampling,
    TransformerConfig,
    VAEConfig,
)
from latentmotion.networks.checkpoint import LatentModel, build

SMALL = TransformerConfig(width=16, layers=3, heads=2, hidden=24)


def untrained(card: ModelCard, vae: VAEConfig, denoiser: DenoiserConfig) -> LatentModel:
    torch.manual_seed(0)
    card = replace(card, vae=vae, denoiser=denoiser)
    return LatentModel(card, build(vae), build(denoiser))


def card(features: int, representation: str, latents: LatentSpace) -> ModelCard:
    return ModelCard(
        name="converted",
        representation=representation,
        normalizer_mean=(0.0,) * features,
        normalizer_std=(1.0,) * features,
        latents=latents,
        schedule=ScaledLinear(),
        parametrization=Epsilon(),
        vae=IdentityVAEConfig(features),
        denoiser=None,
        condition=TextTask("openai/clip-vit-large-patch14", 16),
        sampling=Sampling(),
    )
