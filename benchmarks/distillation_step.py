"""Steps of `latentmotion train distill` on synthetic latents, as a contender."""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

from latentmotion.checkpoint import load_model
from latentmotion.data.clip import Clip
from latentmotion.data.sampling import Cropping, Item
from latentmotion.diffusion.loss import leap_loss
from latentmotion.distillation import Distillation
from latentmotion.model.card import ModelCard
from latentmotion.model.folder import find_model
from latentmotion.runtime.conditions import condition_of
from latentmotion.training.consistency import WithinPhases
from latentmotion.training.crops import Plan
from latentmotion.training.distill import student_card, student_of
from latentmotion.training.latents import LatentMemory, Posteriors, keep_crops
from latentmotion.training.steering import PromptTable
from latentmotion.training.trajectories import Guide
from training_steps import PLACE

CAPTIONS = ("a person walks forward", "a person turns to the left and kicks with the right leg")


class DistillationStage(nn.Module):
    """A student of a shipped model, by phased consistency: it, its average and its teacher run."""

    def __init__(self, teacher: str, settings: Distillation, batch: int, frames: int) -> None:
        super().__init__()
        guide, training = _guide(teacher, settings), settings.training
        self.card, self.knee = student_card(guide.card, settings), settings.knee
        self.network = student_of(guide.network, self.card.trained_denoiser)
        self.average = copy.deepcopy(self.network).eval().forward
        plan, latents = _shown(self.card, batch, frames)
        self.source = WithinPhases(guide, plan, latents, training, PLACE)

    def forward(self, step: int) -> dict[str, Tensor]:
        """Losses of a step."""
        batch = self.source(step, self.average)
        schedule, prediction = self.card.schedule, self.card.prediction
        return {"total": leap_loss(self.network, batch, schedule, prediction, self.knee)}


def _guide(teacher: str, settings: Distillation) -> Guide:
    folder = find_model(teacher)
    model = load_model(folder)
    network, precision = model.denoiser.eval().requires_grad_(False), settings.training.precision
    prompts = PromptTable(condition_of(model.card, folder), CAPTIONS, PLACE.device)
    return Guide(
        network, model.card, settings.leaps, prompts, PLACE.device, settings.solver, precision
    )


def _shown(card: ModelCard, batch: int, frames: int) -> tuple[Plan, LatentMemory]:
    """Motions of one length, whose latents are noise."""
    clips = [Clip(str(n), "", "train", (), None, False, frames) for n in range(batch)]
    items = [Item(clip, 0, frames, CAPTIONS) for clip in clips]
    kept = keep_crops(items, Cropping(max_frames=frames, min_frames=frames), 1, 0)
    crops = kept.every()
    mean = torch.randn(len(crops), card.latents.tokens_of(frames), card.latents.width)
    posteriors = Posteriors(mean, torch.ones_like(mean), mean[..., 0].isfinite())
    return Plan(items, batch, kept, 0), LatentMemory(crops, posteriors)
