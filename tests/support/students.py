"""A small untrained distilled model of actions, with every graph that an export makes."""

from __future__ import annotations

from pathlib import Path

import torch

from latentmotion.diffusion.condition import ActionTask
from latentmotion.diffusion.parametrization import Velocity
from latentmotion.diffusion.schedule import LinearPath
from latentmotion.export.package import package_model
from latentmotion.model.card import ModelCard
from latentmotion.model.config import (
    ConvolutionalVAEConfig,
    DenoiserConfig,
    FewStepConfig,
    LatentSpace,
    Sampling,
    TransformerConfig,
)
from latentmotion.networks.checkpoint import LatentModel, build, save_model
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from tests.support.walker import walker


def write_student(folder: Path) -> Path:
    """Exports a student of 2 or 8 steps, 8 by default; returns the model folder."""
    torch.manual_seed(0)
    vae = ConvolutionalVAEConfig(width=16, channels=8, dilations=(1,))
    denoiser = DenoiserConfig(
        latent_width=8,
        condition_width=6,
        transformer=TransformerConfig(width=16, layers=1, heads=2, hidden=24),
        sine_width=16,
        length_token=True,
        few_step=FewStepConfig(guidance=(1.0, 4.0), steps=(2, 8), solver_steps=8),
    )
    features = HUMANML3D_FEATURES.encode(walker(60).joints())
    card = ModelCard(
        name="untrained",
        representation="humanml3d",
        normalizer_mean=tuple(features.mean(axis=0).tolist()),
        normalizer_std=(0.05,) * 263,
        latents=LatentSpace(8, frames_per_token=4, mean=(0.1, 0.2) * 4, std=(1.5,) * 8),
        schedule=LinearPath(),
        parametrization=Velocity(),
        vae=vae,
        denoiser=denoiser,
        condition=ActionTask(tuple("012345")),
        sampling=Sampling(steps=8, guidance=1.0),
    )
    networks = build(vae), build(denoiser)
    for weight in networks[0].decoder.parameters():  # some of which are nothing at first
        torch.nn.init.normal_(weight, std=0.1)
    for weight in networks[1].step_embedding.parameters():
        torch.nn.init.normal_(weight, std=0.3)
    save_model(folder / "run", LatentModel(card, *networks))
    package_model(folder / "run", card, None, folder / "model")
    return folder / "model"
