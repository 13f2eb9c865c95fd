"""Where the leaps of a step come from; `AlongWays` takes them from ways that the teacher has gone.

Each leap's end is the teacher's own, so nothing is learned from the student's guesses, and training
is a plain regression, as in knowledge distillation (Luhman & Luhman 2021).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Int

from latentmotion.data.sampling import Crop
from latentmotion.diffusion.leaps import Leap, Leaps
from latentmotion.diffusion.loss import LeapBatch
from latentmotion.diffusion.schedule import Schedule
from latentmotion.experiment import TrainingSettings
from latentmotion.training.devices import Place
from latentmotion.training.randomness import StepRandomness
from latentmotion.training.steering import PromptTable
from latentmotion.training.trajectories import Trajectories


@runtime_checkable
class LeapSource(Protocol):
    """What a student learns from."""

    def __call__(self, step: int, average: Callable[..., torch.Tensor]) -> LeapBatch:
        """Returns the leaps of step number `step`, those of this rank.

        Args:
            step: A function of it and the seed alone is what is drawn.
            average: The student with averaged weights.
        """
        ...


@dataclass(frozen=True)
class Phases:
    """Where leaps begin and end, one per item, in steps of the teacher's solver."""

    counts: Int[torch.Tensor, " batch"]
    """In how many leaps the whole way is gone."""
    first: Int[torch.Tensor, " batch"]
    """Where the leap begins."""
    last: Int[torch.Tensor, " batch"]
    """Where it ends."""


def drawn_phases(leaps: Leaps, kind: torch.Tensor, place: torch.Tensor) -> Phases:
    """Turns two numbers in [0, 1) per item into a leap: each size is as likely, then where."""
    known = torch.tensor(leaps.steps, device=kind.device)
    counts = known[(kind * len(known)).long()]
    size = leaps.of // counts
    first = (place * counts).long() * size
    return Phases(counts, first, first + size)


@dataclass(frozen=True)
class Ways:
    """What the teacher was asked for, and how it went."""

    crops: tuple[Crop, ...]
    """What each way was asked for; ways that are neighbors are of similar length."""
    ways: Trajectories
    """The ways."""

    def rows(self, step: int, batch: int, seed: int) -> range:
        """Returns the rows of step number `step`: neighbors, each at most once an epoch.

        Those left over where blocks of `batch` do not make up all are never shown.
        """
        count = max(len(self.crops) // batch, 1)
        epoch, index = divmod(step, count)
        block = int(np.random.default_rng([seed, epoch]).permutation(count)[index])
        return range(block * batch, min((block + 1) * batch, len(self.crops)))


class AlongWays:
    """Leaps between the stops of the teacher's ways.

    Args:
        data: The ways.
        prompts: What the denoiser sees of their captions.
        leaps: What the student shall be able to do.
        schedule: The teacher's.
        training: Batch and seed.
        place: The device and rank.
    """

    def __init__(
        self,
        data: Ways,
        prompts: PromptTable,
        leaps: Leaps,
        schedule: Schedule,
        training: TrainingSettings,
        place: Place,
    ) -> None:
        self._data, self._prompts, self._leaps = data, prompts, leaps
        self._training, self._place = training, place
        self._times = torch.from_numpy(schedule.times(leaps.of)).to(place.device)
        self._stops = torch.tensor(leaps.stops, device=place.device)

    def __call__(self, step: int, average: Callable[..., torch.Tensor]) -> LeapBatch:
        """Returns leaps of the ways whose turn it is."""
        ranks, device = self._place.ranks, self._place.device
        among = self._data.rows(step, self._training.batch_size, self._training.seed)
        own = among[ranks.share(len(among))]
        chance = StepRandomness(self._training.seed, step, len(among), ranks, device)
        phases = drawn_phases(self._leaps, chance.uniform(), chance.uniform())
        ways = self._data.ways.take(own, among).to(device)
        row = torch.arange(len(own), device=device)
        first, last = (torch.searchsorted(self._stops, at) for at in (phases.first, phases.last))
        return LeapBatch(
            start=ways.points[row, first],
            end=ways.points[row, last],
            times=(self._times[phases.first], self._times[phases.last]),
            condition=self._prompts([self._data.crops[index].caption for index in own]),
            mask=ways.mask,
            leap=Leap(ways.guidance, 1 / phases.counts),
        )
