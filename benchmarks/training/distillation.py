"""Steps of `latentmotion train distill` on synthetic latents, as a contender."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from benchmarks.training.steps import CONTEXT
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Crop
from latentmotion.model.card import ModelCard, find_model
from latentmotion.model.config import FewStepConfig
from latentmotion.networks.backend import find_encoder
from latentmotion.networks.checkpoint import load_model
from latentmotion.training.denoiser_loss import step_loss
from latentmotion.training.distillation.data import Distillation
from latentmotion.training.distillation.stage import student_card, student_of
from latentmotion.training.distillation.trajectories import (
    PromptedTrajectories,
    Trajectories,
    TrajectorySteps,
)
from latentmotion.training.task_conditions import ConditionTable

CAPTIONS = ("a person walks forward", "a person turns to the left and kicks with the right leg")


class DistillationStage(nn.Module):
    """A student of a shipped model, on trajectories of noise."""

    def __init__(self, teacher: str, settings: Distillation, batch: int, frames: int) -> None:
        super().__init__()
        folder = find_model(teacher)
        model = load_model(folder)
        condition = model.card.prompt_condition(lambda: find_encoder(model.card, folder))
        prompts = ConditionTable(condition, CAPTIONS, CONTEXT.device)
        self.card, self.huber_delta = student_card(model.card, settings), settings.huber_delta
        self.network = student_of(model.denoiser, self.card.trained_denoiser)
        training = replace(settings.training, batch_size=batch)
        data, few_step = (
            _trajectories(self.card, settings.few_step, batch, frames),
            settings.few_step,
        )
        schedule = self.card.schedule
        self.source = TrajectorySteps(data, prompts, few_step, schedule, training, CONTEXT)

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        batch = self.source(step)
        schedule, parametrization = self.card.schedule, self.card.parametrization
        return {
            "total": step_loss(self.network, batch, schedule, parametrization, self.huber_delta)
        }


def _trajectories(
    card: ModelCard, few_step: FewStepConfig, batch: int, frames: int
) -> PromptedTrajectories:
    """Trajectories of motions of one length, whose latents are noise."""
    clip = Clip("0", "", "train", (), None, False, frames)
    crops = tuple(Crop(clip, 0, frames, CAPTIONS[n % len(CAPTIONS)]) for n in range(batch))
    tokens = card.latents.tokens_of(frames)
    points = torch.randn(batch, len(few_step.stops), tokens, card.latents.width)
    mask, rows = torch.ones(batch, tokens, dtype=torch.bool), torch.arange(batch)
    guidance = torch.full((batch,), few_step.guidance[1])
    return PromptedTrajectories(crops, Trajectories(points, mask, guidance, rows))
