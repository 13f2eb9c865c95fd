"""Steps of `latentmotion train distill` on synthetic latents, as a contender."""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

from benchmarks.training.steps import CONTEXT
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Cropping, Item
from latentmotion.model.card import ModelCard, find_model
from latentmotion.networks.backend import find_encoder
from latentmotion.networks.checkpoint import load_model
from latentmotion.training.denoiser import LatentCache, Posteriors, keep_crops
from latentmotion.training.denoiser_loss import step_loss
from latentmotion.training.distillation.data import Distillation
from latentmotion.training.distillation.stage import student_card, student_of
from latentmotion.training.distillation.trajectories import PhaseSteps, Teacher
from latentmotion.training.task_conditions import ConditionTable
from latentmotion.training.vae import BatchSampler

CAPTIONS = ("a person walks forward", "a person turns to the left and kicks with the right leg")


class DistillationStage(nn.Module):
    """A student of a shipped model, by phased consistency: it, its average and its teacher run."""

    def __init__(self, teacher: str, settings: Distillation, batch: int, frames: int) -> None:
        super().__init__()
        teacher, training = _guide(teacher, settings), settings.training
        self.card, self.huber_delta = student_card(teacher.card, settings), settings.huber_delta
        self.network = student_of(teacher.network, self.card.trained_denoiser)
        self.average = copy.deepcopy(self.network).eval().forward
        batches, latents = _shown(self.card, batch, frames)
        self.source = PhaseSteps(teacher, batches, latents, training, CONTEXT)

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        batch = self.source(step, self.average)
        schedule, parametrization = self.card.schedule, self.card.parametrization
        return {
            "total": step_loss(self.network, batch, schedule, parametrization, self.huber_delta)
        }


def _guide(teacher: str, settings: Distillation) -> Teacher:
    folder = find_model(teacher)
    model = load_model(folder)
    network, precision = model.denoiser.eval().requires_grad_(False), settings.training.precision
    condition = model.card.prompt_condition(lambda: find_encoder(model.card, folder))
    prompts = ConditionTable(condition, CAPTIONS, CONTEXT.device)
    return Teacher(
        network, model.card, settings.few_step, prompts, CONTEXT.device, settings.solver, precision
    )


def _shown(card: ModelCard, batch: int, frames: int) -> tuple[BatchSampler, LatentCache]:
    """Motions of one length, whose latents are noise."""
    clips = [Clip(str(n), "", "train", (), None, False, frames) for n in range(batch)]
    items = [Item(clip, 0, frames, CAPTIONS) for clip in clips]
    kept = keep_crops(items, Cropping(max_frames=frames, min_frames=frames), 1, 0)
    crops = kept.every()
    mean = torch.randn(len(crops), card.latents.tokens_of(frames), card.latents.width)
    posteriors = Posteriors(mean, torch.ones_like(mean), mean[..., 0].isfinite())
    return BatchSampler(items, batch, kept, 0), LatentCache(crops, posteriors)
