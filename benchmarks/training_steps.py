"""Steps of `latentmotion train` on synthetic numbers, as contenders: both stages.

Stage 2 finds latents and sentences in memory, as it does in a run.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from contest import Contender, whole
from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.guidance import drop
from latentmotion.diffusion.loss import denoiser_loss
from latentmotion.experiment import Experiment, TrainingSettings
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.devices import Place
from latentmotion.training.loop import optimize
from latentmotion.training.randomness import Ranks, StepRandomness
from latentmotion.vae.loss import vae_losses

FEATURES = 263
PLACE = Place(torch.device("cpu"), Ranks())


def steps_of(stage: nn.Module, settings: TrainingSettings) -> Contender:
    """Returns a stage as a contender: step after step of its optimization."""
    optimizer = torch.optim.AdamW(stage.parameters(), settings.learning_rate)
    numbers = iter(range(10**9))
    return whole(lambda: optimize(stage, optimizer, settings, next(numbers), PLACE))


class FirstStage(nn.Module):
    """The VAE on features."""

    def __init__(self, experiment: Experiment, batch: int, frames: int) -> None:
        super().__init__()
        self.network, self.objective = experiment.vae.build(), experiment.vae_objective
        self.features = torch.randn(batch, frames, FEATURES) / 10
        self.mask = torch.ones(batch, frames, dtype=torch.bool)

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        noise = StepRandomness(0, step, len(self.features), Ranks()).normal
        decode, fps = HUMANML3D_FEATURES.decode, HUMANML3D_FEATURES.fps
        return vae_losses(
            self.network, self.features, self.mask, noise, decode, fps, self.objective
        )


class SecondStage(nn.Module):
    """The denoiser on remembered latents and sentences."""

    def __init__(self, experiment: Experiment, batch: int, frames: int) -> None:
        super().__init__()
        self.network, self.objective = experiment.denoiser.build(), experiment.denoiser_objective
        shown = experiment.vae.build().latent_mask(torch.ones(batch, frames, dtype=torch.bool))
        width, words = experiment.denoiser.latent_width, experiment.denoiser.condition_width
        self.mask, seen = shown, experiment.reading.words + experiment.reading.pooled
        self.mean, self.std = torch.randn(2, 1000, shown.shape[1], width)
        self.sentences = torch.randn(1000, seen, words)

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        randomness = StepRandomness(0, step, len(self.mask), Ranks())
        rows = (randomness.uniform() * 1000).long()
        shape = self.mean.shape[1:]
        z0 = self.mean[rows] + self.std[rows] * randomness.normal(*shape)
        real = torch.ones(len(rows), self.sentences.shape[1], dtype=torch.bool)
        condition = Conditioning(self.sentences[rows], real)
        null = Conditioning(self.sentences[:1], real[:1])
        condition = drop(condition, null, randomness.chance(self.objective.dropped))
        epsilon, t = randomness.normal(*shape), self.objective.time(randomness.normal())
        loss = denoiser_loss(self.network, z0, epsilon, t, condition, self.mask, self.objective)
        return {"total": loss}
