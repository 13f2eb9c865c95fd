"""Steps of `latentmotion train` on synthetic numbers: both stages, on any device.

As in a run, stage 2 finds latents and sentences on its device, and random numbers are drawn on the
CPU.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import torch
from torch import Tensor, nn

from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.guidance import drop
from latentmotion.networks.checkpoint import build
from latentmotion.networks.vae.interface import vae_losses
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.denoiser_loss import denoiser_loss
from latentmotion.training.distributed import DistributedContext, Ranks, StepRandomness
from latentmotion.training.experiment import Experiment, TrainingSettings
from latentmotion.training.loop import optimize

FEATURES = 263
CONTEXT = DistributedContext(torch.device("cpu"), Ranks())


def step_of(
    stage: nn.Module, settings: TrainingSettings, context: DistributedContext = CONTEXT
) -> Callable[[], object]:
    """Returns what makes the next step of a stage's optimization whenever it is called."""
    optimizer = torch.optim.AdamW(stage.parameters(), settings.learning_rate, fused=True)
    numbers = itertools.count()
    return lambda: optimize(stage, optimizer, settings, next(numbers), context)


class FirstStage(nn.Module):
    """The VAE on features."""

    def __init__(
        self, experiment: Experiment, batch: int, frames: int, device: torch.device = CONTEXT.device
    ) -> None:
        super().__init__()
        self.network = build(experiment.vae).to(device)
        self.objective = experiment.vae_objective
        self.features = torch.randn(batch, frames, FEATURES, device=device) / 10
        self.mask = torch.ones(batch, frames, dtype=torch.bool, device=device)

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        features, mask = self.features, self.mask
        noise = StepRandomness(0, step, len(mask), Ranks(), mask.device).normal
        decode, fps = HUMANML3D_FEATURES.decode, HUMANML3D_FEATURES.fps
        return vae_losses(self.network, features, mask, noise, decode, fps, self.objective)


class SecondStage(nn.Module):
    """The denoiser on remembered latents and sentences."""

    def __init__(
        self, experiment: Experiment, batch: int, frames: int, device: torch.device = CONTEXT.device
    ) -> None:
        super().__init__()
        config, conditioning = experiment.denoiser, experiment.conditioning
        self.network, self.objective = build(config).to(device), experiment.denoiser_objective
        shown = build(experiment.vae).latent_mask(torch.ones(batch, frames, dtype=torch.bool))
        self.mask, words = shown.to(device), conditioning.words + conditioning.pooled
        kept = 2, 1000, shown.shape[1], config.latent_width
        self.mean, self.std = torch.randn(kept, device=device)
        self.sentences = torch.randn(1000, words, config.condition_width, device=device)

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        randomness = StepRandomness(0, step, len(self.mask), Ranks(), self.mask.device)
        rows = (randomness.uniform() * 1000).long()
        shape = self.mean.shape[1:]
        z0 = self.mean[rows] + self.std[rows] * randomness.normal(*shape)
        words = self.sentences[rows]
        real = torch.ones_like(words[..., 0], dtype=torch.bool)
        condition = Conditioning(words, real)
        null = Conditioning(self.sentences[:1], real[:1])
        condition = drop(condition, null, randomness.chance(self.objective.dropped))
        epsilon, t = randomness.normal(*shape), self.objective.time(randomness.normal())
        loss = denoiser_loss(self.network, z0, epsilon, t, condition, self.mask, self.objective)
        return {"total": loss}
