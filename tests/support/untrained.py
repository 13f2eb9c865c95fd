"""Model folders' parts without training: small networks and the card of a model."""

from __future__ import annotations

from dataclasses import replace

import torch

from latentmotion.checkpoint import TrainedModel, describe
from latentmotion.diffusion.denoiser import DenoiserConfig
from latentmotion.diffusion.prediction import Epsilon
from latentmotion.diffusion.schedule import ScaledLinear
from latentmotion.model_card import LatentSpace, ModelCard
from latentmotion.nn.transformer import TransformerConfig
from latentmotion.vae.transformer import TransformerVAEConfig

SMALL = TransformerConfig(width=16, layers=3, heads=2, hidden=24)


def untrained(
    card: ModelCard, vae: TransformerVAEConfig | None, denoiser: DenoiserConfig
) -> TrainedModel:
    torch.manual_seed(0)
    card = replace(card, vae=describe(vae), denoiser=describe(denoiser))
    return TrainedModel(card, vae.build() if vae else None, denoiser.build())


def card(task: str, features: int, representation: str, latents: LatentSpace) -> ModelCard:
    return ModelCard(
        name="converted",
        task=task,  # type: ignore[arg-type]
        representation=representation,
        normalizer_mean=(0.0,) * features,
        normalizer_std=(1.0,) * features,
        latents=latents,
        schedule=ScaledLinear(),
        prediction=Epsilon(),
        vae={},
        denoiser={},
        condition={"encoder": "openai/clip-vit-large-patch14", "width": 16},
        guidance=7.5,
    )
