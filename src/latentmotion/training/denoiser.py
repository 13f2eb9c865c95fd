"""The second stage: the denoiser is trained on the latents of a VAE (paper, section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from latentmotion.data.sampling import Crop
from latentmotion.diffusion.guidance import drop, guided
from latentmotion.diffusion.parametrization import ParametrizedDenoiser
from latentmotion.diffusion.samplers import sampler_named
from latentmotion.motion import Motion
from latentmotion.networks.denoiser import Denoiser
from latentmotion.training.crops import BatchSampler
from latentmotion.training.denoiser_loss import denoiser_loss
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import Experiment
from latentmotion.training.latents import FrameCache, LatentCache
from latentmotion.training.loop import Stage
from latentmotion.training.previews import Previews
from latentmotion.training.rng import Ranks, StepRandomness
from latentmotion.training.task_conditions import ConditionTable

DRAWS = 4
"""Times and noises at which held-out motions are measured."""

SAMPLING_STEPS = 20
"""Most sampling steps of the motions in a picture."""


@dataclass(frozen=True)
class LatentData:
    """What stage 2 learns from."""

    batches: BatchSampler
    """Which crops each step shows."""
    held_out: tuple[Crop, ...]
    """Crops that are only measured."""
    latents: LatentCache | FrameCache
    """Posteriors of all these crops, in the denoiser's scale."""
    prompts: ConditionTable
    """What the denoiser sees of all their captions."""


class DenoiserStage(Stage[Denoiser]):
    """Training of the denoiser: the network, its training latents and its held-out ones.

    Args:
        denoiser: The network to train.
        data: Latents and prompts.
        previews: Makes motions, to look at samples.
        experiment: Which objective.
        context: The device and rank.
    """

    def __init__(
        self,
        denoiser: Denoiser,
        data: LatentData,
        previews: Previews,
        experiment: Experiment,
        context: DistributedContext,
    ) -> None:
        super().__init__()
        self.network = denoiser
        self._data, self._previews, self._context = data, previews, context
        self._experiment, self._null = experiment, data.prompts([""])
        self._spread = float(experiment.latents.sampled)

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        crops, ranks = self._data.batches(step), self._context.ranks
        seed = self._experiment.denoiser_training.seed
        randomness = StepRandomness(seed, step, len(crops), ranks, self._context.device)
        own = crops[ranks.shard(len(crops))]
        dropped = self._experiment.denoiser_objective.dropped
        return {"total": self._loss(self.network, own, crops, randomness, dropped)}

    @torch.no_grad()
    def validate(self, network: Denoiser) -> dict[str, float]:
        """Mean loss of held-out motions and of as many seen ones, at the same times and noises."""
        held_out = self._data.held_out
        seen = self._data.batches(0)[: len(held_out)]
        parts = {"loss": held_out, "loss_of_seen": seen} if held_out else {}
        return {name: self._mean_loss(network, crops) for name, crops in parts.items()}

    @torch.no_grad()
    def sample(self, network: Denoiser) -> list[Motion]:
        """Motions for the prompts of a few held-out clips."""
        every = [crop.caption for crop in self._data.held_out]
        captions = [caption for caption in every if caption] or every
        captions = captions[:: max(1, len(captions) // 4)][:4]
        if not captions:
            return []
        objective, sampling = self._experiment.denoiser_objective, self._experiment.sampling
        condition = self._data.prompts(captions)
        model = ParametrizedDenoiser(network, objective.parametrization, objective.schedule)
        model = guided(sampling.guidance_rule, model, self._null, sampling.guidance)
        sampler = sampler_named(sampling.sampler, objective.schedule)
        steps = min(SAMPLING_STEPS, sampling.steps)
        return self._previews.sample(model, sampler, steps, condition, captions)

    def _loss(
        self,
        network: Denoiser,
        crops: Sequence[Crop],
        among: Sequence[Crop],
        randomness: StepRandomness,
        dropped: float,
    ) -> torch.Tensor:
        objective, spread = self._experiment.denoiser_objective, self._spread
        latents = self._data.latents.batch(crops, among)
        shape = latents.mean.shape[1:]
        z0 = latents.mean + spread * latents.std * randomness.normal(*shape)
        epsilon, t = randomness.normal(*shape), objective.time(randomness.normal())
        condition = self._data.prompts([crop.caption for crop in crops])
        condition = drop(condition, self._null, randomness.chance(dropped))
        return denoiser_loss(network, z0, epsilon, t, condition, latents.mask, objective)

    def _mean_loss(self, network: Denoiser, crops: Sequence[Crop]) -> float:
        device = self._context.device
        draws = (StepRandomness(n, 0, len(crops), Ranks(), device) for n in range(DRAWS))
        losses = [self._loss(network, crops, crops, draw, dropped=0.0) for draw in draws]
        return float(torch.stack(losses).mean())
