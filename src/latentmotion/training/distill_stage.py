"""Distillation as a stage of the training loop: a student learns leaps and is held to its teacher.

What the leaps are taken from is another part: `leap_sources` or `consistency`.
"""

from __future__ import annotations

import torch

from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.guidance import GuidanceAsInput
from latentmotion.diffusion.loss import leap_loss
from latentmotion.diffusion.sampler import sample
from latentmotion.model.card import ModelCard
from latentmotion.model.config import Sampling
from latentmotion.motion import Motion
from latentmotion.nn.masked import mean_of_real
from latentmotion.pipeline import sampler_of
from latentmotion.training.distill_data import Lessons
from latentmotion.training.loop import Stage
from latentmotion.training.previews import Previews
from latentmotion.training.trajectories import nothing


class DistillStage(Stage[Denoiser]):
    """The student, the leaps that it learns, and ways of its teacher that it never sees.

    Args:
        student: The network to train.
        card: What it becomes.
        lessons: Where leaps and the teacher's ways come from.
        previews: Makes motions, to look at samples.
    """

    def __init__(
        self, student: Denoiser, card: ModelCard, lessons: Lessons, previews: Previews
    ) -> None:
        super().__init__()
        self.network = student
        self._card, self._previews = card, previews
        self._source, self._held_out = lessons.source(), lessons.comparison()
        self._prompts, self._device = lessons.guide.prompts, lessons.place.device
        self._leaps, self._knee = lessons.settings.leaps, lessons.settings.knee

    def follow(self, average: Denoiser) -> None:
        """Remembers the averaged student, but not as a part of this module, which it is not."""
        self._average = average.forward

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        batch = self._source(step, self._average)
        schedule, prediction = self._card.schedule, self._card.prediction
        loss = leap_loss(self.network, batch, schedule, prediction, self._knee)
        return {"total": loss}

    @torch.no_grad()
    def validate(self, network: Denoiser) -> dict[str, float]:
        """How far from the teacher held-out ways end, by steps: root mean square per number."""
        if self._held_out is None:
            return {}
        ways = self._held_out.ways.to(self._device)
        condition = self._prompts([crop.caption for crop in self._held_out.crops])
        figures = {}
        for steps in self._leaps.steps:
            guided = GuidanceAsInput(network, ways.guidance, steps)
            sampler = sampler_of(self._card, Sampling(steps, sampler="ddim"))
            noise = ways.points[:, 0]
            found = sample(guided, sampler, noise, condition, ways.mask, steps, nothing)
            squares = (found - ways.points[:, -1]) ** 2
            figures[f"rms_of_{steps}"] = float(mean_of_real(squares, ways.mask)) ** 0.5
        return figures

    @torch.no_grad()
    def sample(self, network: Denoiser) -> list[Motion]:
        """Motions for the prompts of a few held-out clips, in the most steps that it takes."""
        crops = self._held_out.crops if self._held_out else ()
        captions = [crop.caption for crop in crops][:4]
        if not captions:
            return []
        steps = max(self._leaps.steps)
        guided = GuidanceAsInput(network, self._card.guidance, steps)
        sampler = sampler_of(self._card, Sampling(steps, sampler="ddim"))
        return self._previews.sample(guided, sampler, steps, self._prompts(captions), captions)
