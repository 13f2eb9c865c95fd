"""Phased consistency distillation: leaps that agree with themselves after a step of the teacher.

    motion, noise → z_t inside a phase → one guided step of the teacher → z_t'
    → the averaged student's leap to the phase's end: where the student shall leap from z_t

A phase is one leap of the student's, so it is never asked for anything else (Wang et al. 2024,
phased consistency models; Dai et al. 2024, MotionLCM, for the scale as an input). A leap of no
length leads nowhere by its form, which anchors the agreement at the phase's end.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.leaps import Leap
from latentmotion.diffusion.loss import LeapBatch
from latentmotion.diffusion.prediction import add_noise
from latentmotion.experiment import TrainingSettings
from latentmotion.training.crops import Plan
from latentmotion.training.devices import Place
from latentmotion.training.latents import LatentMemory, Posteriors
from latentmotion.training.leap_sources import drawn_phases
from latentmotion.training.randomness import StepRandomness
from latentmotion.training.raw_frames import FrameMemory
from latentmotion.training.trajectories import Guide


class WithinPhases:
    """Leaps from noised motions to the ends of their phases.

    Args:
        guide: The teacher.
        plan: Which crops each step shows.
        latents: Posteriors of all these crops, in the denoiser's scale.
        training: The seed.
        place: The device and rank.
    """

    def __init__(
        self,
        guide: Guide,
        plan: Plan,
        latents: LatentMemory | FrameMemory,
        training: TrainingSettings,
        place: Place,
    ) -> None:
        self._guide, self._plan, self._latents = guide, plan, latents
        self._seed, self._place = training.seed, place
        times = guide.card.schedule.times(guide.leaps.of)
        self._times = torch.from_numpy(times).to(place.device)

    def __call__(self, step: int, average: Callable[..., Tensor]) -> LeapBatch:
        """Returns leaps of the crops whose turn it is."""
        crops, ranks = self._plan(step), self._place.ranks
        own = crops[ranks.share(len(crops))]
        chance = StepRandomness(self._seed, step, len(crops), ranks, self._place.device)
        phases = drawn_phases(self._guide.leaps, chance.uniform(), chance.uniform())
        first = phases.first + (chance.uniform() * (phases.last - phases.first)).long()
        least, most = self._guide.leaps.guidance
        leap = Leap(least + (most - least) * chance.uniform(), 1 / phases.counts)
        latents = self._latents.batch(own, crops)
        start = self._noised(latents, first, chance)
        condition = self._guide.prompts([crop.caption for crop in own])
        t, after, s = (self._times[at] for at in (first, first + 1, phases.last))
        end = self._end(start, (t, after, s), condition, latents.mask, leap, average)
        return LeapBatch(start, end, (t, s), condition, latents.mask, leap)

    def _noised(self, latents: Posteriors, first: Tensor, chance: StepRandomness) -> Tensor:
        """The way begins with noise alone, as sampling does, even where the schedule keeps some."""
        shape = latents.mean.shape[1:]
        z0, noise = latents.mean + latents.std * chance.normal(*shape), chance.normal(*shape)
        z = add_noise(z0, noise, self._times[first], self._guide.card.schedule)
        return torch.where((first == 0)[:, None, None], noise, z)

    @torch.no_grad()
    def _end(
        self,
        z: Float[Tensor, "batch tokens width"],
        times: tuple[Tensor, Tensor, Tensor],
        condition: Conditioning,
        mask: Tensor,
        leap: Leap,
        average: Callable[..., Tensor],
    ) -> Float[Tensor, "batch tokens width"]:
        """Goes a step with the teacher and on with the averaged student."""
        t, after, s = times
        output = self._guide.guided(leap.guidance)(z, t, condition, mask).float()
        z = self._moved(z, output, t, after)
        there = self._moved(z, average(z, after, condition, mask, leap).float(), after, s)
        # No noise may be left there, of which no prediction can be made.
        return torch.where((after == s)[:, None, None], z, there)

    def _moved(self, z: Tensor, output: Tensor, t: Tensor, s: Tensor) -> Tensor:
        """Makes a step of DDIM, each item between times of its own."""
        card = self._guide.card
        return add_noise(*card.prediction.split(output, z, t, card.schedule), s, card.schedule)
