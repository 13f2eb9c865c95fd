"""The random numbers of one step, a function of (seed, step) alone.

So a snapshot needs no generator state, a resumed run repeats the uninterrupted one bit for bit, and
any number of ranks trains on the same numbers: each array is drawn for the whole batch on the CPU
(a seed means the same on every device), and each rank keeps its rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float


@dataclass(frozen=True)
class Ranks:
    """The rank of this process among all that train together."""

    rank: int = 0
    """Number of this process."""
    world: int = 1
    """Number of processes."""

    def shard(self, rows: int) -> slice:
        """The rows of a whole batch that fall to this rank."""
        return slice(self.rank, rows, self.world)


class StepRandomness:
    """Draws for the whole batch, of which this rank keeps its rows.

    Args:
        seed: Seed of the run.
        step: Number of the step.
        rows: Size of the whole batch, over all ranks.
        ranks: The rank of this process.
        device: Where the numbers are wanted.
    """

    def __init__(
        self, seed: int, step: int, rows: int, ranks: Ranks, device: torch.device | str = "cpu"
    ) -> None:
        words = np.random.SeedSequence([seed, step]).generate_state(2, np.uint64)
        self._generator = torch.Generator().manual_seed(int(words[0] >> 1))
        # Dropout draws from the global generator, by rank: equal masks on all would be correlated.
        torch.manual_seed(int(words[1] >> 1) ^ ranks.rank)
        self._rows, self._share, self._device = rows, ranks.shard(rows), device

    def normal(self, *shape: int) -> Float[torch.Tensor, "batch ..."]:
        """Standard normal numbers, a row of `shape` for each sample of this rank."""
        drawn = torch.randn((self._rows, *shape), generator=self._generator)
        return drawn[self._share].to(self._device)

    def uniform(self) -> Float[torch.Tensor, " batch"]:
        """A number in [0, 1) for each sample of this rank."""
        drawn = torch.rand(self._rows, generator=self._generator)
        return drawn[self._share].to(self._device)

    def chance(self, probability: float) -> Bool[torch.Tensor, " batch"]:
        """True with `probability` for each sample of this rank."""
        return self.uniform() < probability
