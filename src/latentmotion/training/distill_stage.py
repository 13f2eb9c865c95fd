"""Distillation: a student learns its teacher's guided way by leaps of 1, 1/2, 1/4 of it.

Each leap's end is the teacher's own, so nothing is learned from the student's guesses, as it is in
consistency distillation (Song et al. 2023), of whose phases (Wang et al. 2024) these leaps are one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from latentmotion.condition.interface import Conditioning
from latentmotion.data.sampling import Crop
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.guidance import GuidanceAsInput
from latentmotion.diffusion.leaps import Leap, LeapTimes
from latentmotion.diffusion.loss import leap_loss
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.diffusion.sampler import DDIM, sample
from latentmotion.distillation import Distillation
from latentmotion.model_card import ModelCard
from latentmotion.motion import Motion
from latentmotion.nn.masked import mean_of_real
from latentmotion.training.devices import Place
from latentmotion.training.latent_decoder import LatentDecoder
from latentmotion.training.loop import Stage
from latentmotion.training.randomness import StepRandomness
from latentmotion.training.steering import PromptTable
from latentmotion.training.trajectories import Trajectories, nothing


@dataclass(frozen=True)
class Ways:
    """What a student learns from."""

    crops: tuple[Crop, ...]
    """What each way was asked for; ways that are neighbors are of similar length."""
    ways: Trajectories
    """The ways, those of held-out crops last."""
    held_out: int
    """How many these are."""
    prompts: PromptTable
    """What the denoiser sees of all captions."""

    def rows(self, step: int, batch: int, seed: int) -> range:
        """Returns the rows of step number `step`: neighbors, all of them once an epoch."""
        seen = len(self.crops) - self.held_out
        count = max(seen // batch, 1)
        epoch, index = divmod(step, count)
        block = int(np.random.default_rng([seed, epoch]).permutation(count)[index])
        return range(block * batch, min((block + 1) * batch, seen))


class DistillStage(Stage[Denoiser]):
    """The student, and the ways of its teacher.

    Args:
        student: The network to train.
        card: The teacher's.
        data: Ways and prompts.
        decoder: Latents to motions, to look at samples.
        settings: Which leaps, which loss.
        place: The device and rank.
    """

    def __init__(
        self,
        student: Denoiser,
        card: ModelCard,
        data: Ways,
        decoder: LatentDecoder,
        settings: Distillation,
        place: Place,
    ) -> None:
        super().__init__()
        self.network = student
        self._card, self._data, self._decoder = card, data, decoder
        self._settings, self._place = settings, place
        self._leaps = torch.tensor(list(settings.leaps.each()), device=place.device)
        times = card.schedule.times(settings.leaps.of)[settings.leaps.stops]
        self._times = torch.from_numpy(times).to(place.device)

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        training, ranks = self._settings.training, self._place.ranks
        rows = self._data.rows(step, training.batch_size, training.seed)
        chance = StepRandomness(training.seed, step, len(rows), ranks, self._place.device)
        chosen = self._chosen(chance.uniform(), chance.uniform())
        return {"total": self._loss(rows[ranks.share(len(rows))], rows, chosen)}

    @torch.no_grad()
    def validate(self, network: Denoiser) -> dict[str, float]:
        """How far from the teacher held-out ways end, by steps: root mean square per number."""
        rows = range(len(self._data.crops) - self._data.held_out, len(self._data.crops))
        if not rows:
            return {}
        ways = self._data.ways.take(rows, rows).to(self._place.device)
        condition = self._condition(rows)
        figures = {}
        for steps in self._settings.leaps.steps:
            found = self._walk(
                network, ways.points[:, 0], ways.guidance, condition, ways.mask, steps
            )
            squares = (found - ways.points[:, -1]) ** 2
            figures[f"rms_of_{steps}"] = float(mean_of_real(squares, ways.mask)) ** 0.5
        return figures

    @torch.no_grad()
    def sample(self, network: Denoiser) -> list[Motion]:
        """Motions for the prompts of a few held-out clips, in the most steps that it takes."""
        captions = [crop.caption for crop in self._data.crops[::-1]][:4]
        mask = self._decoder.mask(len(captions)).to(self._place.device)
        noise = SeededNoise(range(len(captions)))((*mask.shape, self._card.latents.width))
        z, steps = torch.from_numpy(noise).to(self._place.device), max(self._settings.leaps.steps)
        condition = self._data.prompts(captions)
        z = self._walk(network, z, self._card.guidance, condition, mask, steps)
        return self._decoder(z, captions)

    def _walk(
        self,
        network: Denoiser,
        z: torch.Tensor,
        guidance: float | torch.Tensor,
        condition: Conditioning,
        mask: torch.Tensor,
        steps: int,
    ) -> torch.Tensor:
        told = GuidanceAsInput(network, guidance, steps)
        times = LeapTimes(self._card.schedule, self._settings.leaps)
        return sample(told, DDIM(times, self._card.prediction), z, condition, mask, steps, nothing)

    def _loss(self, own: Sequence[int], among: Sequence[int], chosen: torch.Tensor) -> torch.Tensor:
        ways = self._data.ways.take(own, among).to(self._place.device)
        counts, first, last = chosen.unbind(dim=1)
        row = torch.arange(len(own), device=chosen.device)
        return leap_loss(
            student=self.network,
            start=ways.points[row, first],
            end=ways.points[row, last],
            times=(self._times[first], self._times[last]),
            condition=self._condition(own),
            mask=ways.mask,
            leap=Leap(ways.guidance, 1 / counts),
            parts=(self._card.schedule, self._card.prediction),
            knee=self._settings.knee,
        )

    def _chosen(self, kind: torch.Tensor, place: torch.Tensor) -> torch.Tensor:
        """Turns two numbers in [0, 1) per item into a leap: each size is as likely, then where."""
        steps = torch.tensor(self._settings.leaps.steps, device=kind.device)
        index = (kind * len(steps)).long()
        before = torch.cumsum(steps, dim=0) - steps
        return self._leaps[before[index] + (place * steps[index]).long()]

    def _condition(self, rows: Sequence[int]) -> Conditioning:
        return self._data.prompts([self._data.crops[row].caption for row in rows])
