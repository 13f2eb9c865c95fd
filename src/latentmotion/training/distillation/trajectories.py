"""Guided trajectories of the teacher, and the steps learned on them.

    noise, prompt, guidance w → the teacher's solver, guided → latents at the stops of all steps

They start from noise, as sampling does; noised data would lie off guided trajectories. They are
computed once and kept in the run folder, as latents are for the second stage. The end of every step
is the teacher's own, so training is a plain regression, as in knowledge distillation (Luhman &
Luhman 2021).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from safetensors.torch import load_file

from latentmotion.arrays import prefix_mask
from latentmotion.data.dataset import Crop
from latentmotion.diffusion import samplers
from latentmotion.diffusion.guidance import DistilledGuidance, guided
from latentmotion.diffusion.parametrization import ParametrizedDenoiser
from latentmotion.diffusion.schedule import Schedule, StepCondition
from latentmotion.errors import InputError
from latentmotion.model.card import ModelCard
from latentmotion.model.config import FewStepConfig, Sampling
from latentmotion.networks.denoiser import DenoiserNetwork
from latentmotion.networks.device import autocast
from latentmotion.pipeline import sampler_of
from latentmotion.training.denoiser_loss import StepBatch
from latentmotion.training.distributed import DistributedContext, StepRandomness
from latentmotion.training.experiment import Precision, TrainingSettings
from latentmotion.training.run_folder import write_tensors
from latentmotion.training.takes import joined
from latentmotion.training.task_conditions import ConditionTable

# File of the trajectories in a distillation's run folder.
TRAJECTORIES_FILE = "trajectories.safetensors"


@dataclass(frozen=True)
class Trajectories:
    """Trajectories of the teacher, padded to the longest motion."""

    points: Float[torch.Tensor, "paths stops tokens width"]  # Latents at every stop, noise first.
    mask: Bool[torch.Tensor, "paths tokens"]  # True on real tokens.
    guidance: Float[torch.Tensor, " paths"]  # Guidance scale of each.
    rows: Int[torch.Tensor, " paths"]  # Number of what each was asked.

    def take(self, rows: Sequence[int], among: Sequence[int]) -> Trajectories:
        """Returns some of them, cut to the longest of `among`."""
        longest = int(self.mask[list(among)].sum(dim=1).max())
        chosen = list(rows)
        points, mask = self.points[chosen, :, :longest], self.mask[chosen, :longest]
        return Trajectories(points, mask, self.guidance[chosen], self.rows[chosen])

    def to(self, device: torch.device) -> Trajectories:
        """Returns them on a device."""
        return Trajectories(*(getattr(self, field.name).to(device) for field in fields(self)))


@dataclass(frozen=True)
class Teacher:
    """A trained model that computes trajectories; an earlier student makes its own few steps."""

    network: DenoiserNetwork  # Its denoiser, frozen.
    card: ModelCard  # Its description.
    few_step: FewStepConfig  # The stops at which latents are kept.
    prompts: ConditionTable  # Conditions of the prompts.
    device: torch.device  # Device of its computations.
    solver: samplers.SamplerName  # Its rule of a step, of one pass.
    precision: Precision = "float32"  # Of the network's arithmetic; trajectories stay in float32.

    @torch.no_grad()
    def trajectories(self, crops: Sequence[Crop], seed: int) -> Trajectories:
        """Returns trajectories for the lengths and prompts of some crops."""
        generator = np.random.default_rng(seed)
        guidance = generator.uniform(*self.few_step.guidance, len(crops)).astype(np.float32)
        tokens = [self.card.latents.tokens_of(crop.frames) for crop in crops]
        seeds = generator.integers(2**32, size=len(crops)).tolist()
        z = samplers.SeededNoise(seeds, tokens)((len(crops), max(tokens), self.card.latents.width))
        mask = prefix_mask(torch.tensor(tokens))
        scale = torch.from_numpy(guidance)
        condition = self.prompts([crop.caption for crop in crops])
        start, real = torch.from_numpy(z).to(self.device), mask.to(self.device)
        sampler, steps = self._sampler()
        guided = self.guided(scale.to(self.device))
        with autocast(self.device, self.precision):
            chain = guided, sampler, start, condition, real, steps, nothing
            states = [z for _, z in samplers.trajectory(*chain)]
        stops = [stop * steps // self.few_step.solver_steps for stop in self.few_step.stops]
        points = torch.stack([states[stop] for stop in stops], dim=1)
        return Trajectories(points, mask, scale, torch.arange(len(crops))).to(torch.device("cpu"))

    def _sampler(self) -> tuple[samplers.Sampler, int]:
        """Returns the sampler and its number of steps."""
        few_step = self.card.few_step
        if few_step:
            steps = max(few_step.steps)
            return sampler_of(self.card, Sampling(steps, sampler="ddim")), steps
        return samplers.sampler_named(self.solver, self.card.schedule), self.few_step.solver_steps

    def guided(self, scale: Float[torch.Tensor, " batch"]) -> ParametrizedDenoiser:
        """Returns the teacher's denoiser, guided by a scale for each item."""
        if self.card.few_step:
            distilled = DistilledGuidance(self.network, scale, self._sampler()[1])
            return self.card.parametrized(distilled)
        card, null = self.card, self.prompts([""])
        return guided(card.sampling.guidance_rule, card.parametrized(self.network), null, scale)


def check_stops(former: ModelCard, few_step: FewStepConfig) -> None:
    """Checks that the few steps of an earlier student end where those to learn do.

    Raises:
        InputError: They do not.
    """
    former_steps = former.few_step
    if former_steps and any(
        stop * max(former_steps.steps) % few_step.solver_steps for stop in few_step.stops
    ):
        raise InputError(
            f"model {former.name!r} makes {max(former_steps.steps)} steps, which do not end where "
            f"those of few_step.steps {list(few_step.steps)} do; use {list(former_steps.steps)}"
        )


def cached_trajectories(
    path: Path, compute: Callable[[int], Trajectories], blocks: int, context: DistributedContext
) -> Trajectories:
    """Reads trajectories from `path`; where it is missing, each rank first computes its share.

    Args:
        path: File of all trajectories.
        compute: Returns those of a block.
        blocks: Number of blocks.
        context: Device and rank.
    """
    shares = [path.with_suffix(f".{rank}{path.suffix}") for rank in range(context.ranks.world)]
    share_file = shares[context.ranks.rank]
    if not path.exists() and not share_file.exists():
        computed = {n: compute(n) for n in range(blocks)[context.ranks.shard(blocks)]}
        parts = {f"{n}.{name}": t for n, each in computed.items() for name, t in vars(each).items()}
        write_tensors(share_file, parts)
    context.wait()
    if context.is_main and not path.exists():
        tensors = {name: part for share in shares for name, part in load_file(share).items()}
        every = [
            Trajectories(*(tensors[f"{n}.{field.name}"] for field in fields(Trajectories)))
            for n in range(blocks)
        ]
        write_tensors(path, vars(joined(every)))
        for share in shares:
            share.unlink()
    context.wait()
    return Trajectories(**load_file(path))


def nothing(shape: tuple[int, ...]) -> np.ndarray:
    """Stands for noise where none is drawn."""
    raise AssertionError(f"this solver draws no noise, asked for {shape}")


@dataclass(frozen=True)
class PromptedTrajectories:
    """Trajectories of the teacher, with the crops that they were computed for."""

    # Prompt and length of each trajectory; neighbors are of similar length.
    crops: tuple[Crop, ...]
    trajectories: Trajectories  # The trajectories.
    # Other words for the captions of crops, which the student reads in their place.
    wordings: Mapping[Crop, tuple[str, ...]] = field(default_factory=dict)

    def rows(self, step: int, batch: int, seed: int) -> range:
        """Returns the rows of step number `step`: neighbors, each at most once an epoch.

        Those left over where blocks of `batch` do not make up all are never shown.
        """
        count = self._blocks(batch)
        epoch, index = divmod(step, count)
        block = int(np.random.default_rng([seed, epoch]).permutation(count)[index])
        return range(block * batch, min((block + 1) * batch, len(self.crops)))

    def captions(self, rows: Iterable[int], step: int, batch: int) -> list[str]:
        """Returns what the student reads of `rows` at a step: wordings take turns by epoch."""
        epoch = step // self._blocks(batch)
        crops = [self.crops[row] for row in rows]
        texts = [self.wordings.get(crop, (crop.caption,)) for crop in crops]
        return [wordings[epoch % len(wordings)] for wordings in texts]

    def _blocks(self, batch: int) -> int:
        return max(len(self.crops) // batch, 1)


class TrajectorySteps:
    """Steps between the stops of the teacher's trajectories.

    Args:
        data: The trajectories.
        prompts: What the denoiser sees of their captions.
        few_step: Step counts that the student learns.
        schedule: The teacher's.
        training: Batch and seed.
        context: The device and rank.
    """

    def __init__(
        self,
        data: PromptedTrajectories,
        prompts: ConditionTable,
        few_step: FewStepConfig,
        schedule: Schedule,
        training: TrainingSettings,
        context: DistributedContext,
    ) -> None:
        self._data, self._prompts, self._few_step = data, prompts, few_step
        self._training, self._context = training, context
        self._times = torch.from_numpy(schedule.timesteps(few_step.solver_steps)).to(context.device)
        self._stops = torch.tensor(few_step.stops, device=context.device)

    def __call__(self, step: int) -> StepBatch:
        """Returns steps along the trajectories of training step `step`."""
        ranks, device = self._context.ranks, self._context.device
        batch, seed = self._training.batch_size, self._training.seed
        among = self._data.rows(step, batch, seed)
        shard = among[ranks.shard(len(among))]
        captions = self._data.captions(shard, step, batch)
        chance = StepRandomness(seed, step, len(among), ranks, device)
        # Of each item one of so many equal steps, from `start` to `end` in the solver's steps.
        choices = torch.tensor(self._few_step.steps, device=device)
        counts = choices[(chance.uniform() * len(choices)).long()]
        length = self._few_step.solver_steps // counts
        start = (chance.uniform() * counts).long() * length
        end = start + length
        trajectories = self._data.trajectories.take(shard, among).to(device)
        row = torch.arange(len(shard), device=device)
        first, last = (torch.searchsorted(self._stops, at) for at in (start, end))
        return StepBatch(
            start=trajectories.points[row, first],
            end=trajectories.points[row, last],
            times=(self._times[start], self._times[end]),
            condition=self._prompts(captions),
            mask=trajectories.mask,
            step_condition=StepCondition(trajectories.guidance, 1 / counts),
        )
