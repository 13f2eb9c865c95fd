"""Phased consistency distillation: steps that agree with themselves after one of the teacher.

    motion, noise → z_t inside a phase → one guided step of the teacher → z_t'
    → the averaged student's step to the phase's end, the student's target at z_t

A phase is one step of the student's, so no other step is ever trained (Wang et al. 2024,
phased consistency models; Dai et al. 2024, MotionLCM, for the scale as an input). A step of no
length leads nowhere by its form, which anchors the agreement at the phase's end.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.few_step import StepCondition
from latentmotion.diffusion.parametrization import add_noise
from latentmotion.training.crops import BatchSampler
from latentmotion.training.denoiser_loss import StepBatch
from latentmotion.training.distillation.trajectories import Teacher, drawn_phases
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import TrainingSettings
from latentmotion.training.latents import FrameCache, LatentCache, Posteriors
from latentmotion.training.rng import StepRandomness


class PhaseSteps:
    """Steps from noised motions to the ends of their phases.

    Args:
        teacher: The teacher.
        batches: Which crops each step shows.
        latents: Posteriors of all these crops, in the denoiser's scale.
        training: The seed.
        context: The device and rank.
    """

    def __init__(
        self,
        teacher: Teacher,
        batches: BatchSampler,
        latents: LatentCache | FrameCache,
        training: TrainingSettings,
        context: DistributedContext,
    ) -> None:
        self._teacher, self._batches, self._latents = teacher, batches, latents
        self._seed, self._context = training.seed, context
        times = teacher.card.schedule.timesteps(teacher.few_step.solver_steps)
        self._times = torch.from_numpy(times).to(context.device)

    def __call__(self, step: int, average: Callable[..., Tensor]) -> StepBatch:
        """Returns steps for the crops of training step `step`."""
        crops, ranks = self._batches(step), self._context.ranks
        own = crops[ranks.shard(len(crops))]
        chance = StepRandomness(self._seed, step, len(crops), ranks, self._context.device)
        phases = drawn_phases(self._teacher.few_step, chance.uniform(), chance.uniform())
        first = phases.first + (chance.uniform() * (phases.last - phases.first)).long()
        least, most = self._teacher.few_step.guidance
        step_condition = StepCondition(least + (most - least) * chance.uniform(), 1 / phases.counts)
        latents = self._latents.batch(own, crops)
        start = self._noised(latents, first, chance)
        condition = self._teacher.prompts([crop.caption for crop in own])
        t, after, s = (self._times[at] for at in (first, first + 1, phases.last))
        end = self._end(start, (t, after, s), condition, latents.mask, step_condition, average)
        return StepBatch(start, end, (t, s), condition, latents.mask, step_condition)

    def _noised(self, latents: Posteriors, first: Tensor, chance: StepRandomness) -> Tensor:
        """The first timestep is noise alone, as in sampling, even if the schedule keeps signal."""
        shape = latents.mean.shape[1:]
        z0, noise = latents.mean + latents.std * chance.normal(*shape), chance.normal(*shape)
        z = add_noise(z0, noise, self._times[first], self._teacher.card.schedule)
        return torch.where((first == 0)[:, None, None], noise, z)

    @torch.no_grad()
    def _end(
        self,
        z: Float[Tensor, "batch tokens width"],
        times: tuple[Tensor, Tensor, Tensor],
        condition: Conditioning,
        mask: Tensor,
        step_condition: StepCondition,
        average: Callable[..., Tensor],
    ) -> Float[Tensor, "batch tokens width"]:
        """Takes a step with the teacher, then one with the averaged student."""
        t, after, s = times
        guided = self._teacher.guided(step_condition.guidance).denoiser
        output = guided(z, t, condition, mask).float()
        z = self._moved(z, output, t, after)
        there = self._moved(z, average(z, after, condition, mask, step_condition).float(), after, s)
        # No noise may be left there, which determines no prediction.
        return torch.where((after == s)[:, None, None], z, there)

    def _moved(self, z: Tensor, output: Tensor, t: Tensor, s: Tensor) -> Tensor:
        """Makes a step of DDIM, each item between times of its own."""
        card = self._teacher.card
        return add_noise(
            *card.parametrization.to_x0_eps(output, z, t, card.schedule), s, card.schedule
        )
