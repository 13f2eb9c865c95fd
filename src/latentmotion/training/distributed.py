"""A training process: its device, its rank under torchrun, the random numbers of a step, sharding.

So a snapshot needs no generator state, a resumed run repeats the uninterrupted one bit for bit, and
any number of ranks trains on the same numbers: each array is drawn for the whole batch on the CPU
(a seed means the same on every device), and each rank keeps its rows.

Fully sharded (FSDP), each rank holds a part of the weights, gradients and moments, and a layer's
weights are gathered where it is computed. What is written is whole, so that a run is resumed with
any number of ranks, sharded or replicated.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import torch
import torch.distributed
from jaxtyping import Bool, Float
from torch import nn
from torch.distributed.device_mesh import init_device_mesh
from torch.distributed.distributed_c10d import PrefixStore
from torch.distributed.rendezvous import rendezvous

from latentmotion.errors import InputError
from latentmotion.networks.device import GPU, default_device, device_named
from latentmotion.training.experiment import TrainingSettings


@dataclass(frozen=True)
class Ranks:
    """The rank of this process among all that train together."""

    rank: int = 0  # Number of this process.
    world: int = 1  # Number of processes.

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
        self._generator = torch.Generator().manual_seed(int(words[0]) >> 1)
        # Dropout draws from the global generator, by rank: equal masks on all would be correlated.
        torch.manual_seed((int(words[1]) >> 1) ^ ranks.rank)
        self._rows, self._share, self._device = rows, ranks.shard(rows), device

    def normal(self, *shape: int) -> Float[torch.Tensor, "batch ..."]:
        """Standard normal numbers, a row of `shape` for each sample of this rank."""
        drawn = torch.randn((self._rows, *shape), generator=self._generator)
        return drawn[self._share].to(self._device)

    def uniform(self) -> Float[torch.Tensor, " batch"]:
        """A number in [0, 1) for each sample of this rank."""
        return torch.rand(self._rows, generator=self._generator)[self._share].to(self._device)

    def chance(self, probability: float) -> Bool[torch.Tensor, " batch"]:
        """True with `probability` for each sample of this rank."""
        return self.uniform() < probability


@dataclass(frozen=True)
class DistributedContext:
    """The device and the rank of a training process."""

    device: torch.device  # Where networks and batches live.
    ranks: Ranks  # Number of this process and of all.

    @property
    def is_main(self) -> bool:
        """Whether this process writes the run folder."""
        return self.ranks.rank == 0

    def mean(self, figures: Mapping[str, torch.Tensor]) -> dict[str, float]:
        """Averages figures over all ranks; every rank must call it."""
        values = torch.stack([v.detach().float().to(self.device) for v in figures.values()])
        if self.ranks.world > 1:
            torch.distributed.all_reduce(values)
        return dict(zip(figures, (values / self.ranks.world).tolist(), strict=True))

    def check_same_step(self, step: int) -> None:
        """Raises InputError where ranks disagree about the step of the snapshot."""
        if self.ranks.world == 1:
            return
        here = torch.tensor(step, device=self.device)
        everyone = [torch.zeros_like(here) for _ in range(self.ranks.world)]
        torch.distributed.all_gather(everyone, here)
        steps = [int(item) for item in everyone]
        if len(set(steps)) > 1:
            raise InputError(
                f"ranks disagree about the snapshot's step: {steps}; expected one run folder that "
                "all hosts share"
            )

    def wait(self) -> None:
        """Returns when every rank has come here."""
        if self.ranks.world > 1:
            torch.distributed.barrier()


@contextmanager
def distributed_context(device: str = "auto") -> Iterator[DistributedContext]:
    """Yields this process's context; under torchrun it joins the others (nccl on GPUs, else gloo).

    Args:
        device: "cpu", "cuda", "cuda:1" or "auto" (a GPU where there is one).

    Raises:
        InputError: No such device.
    """
    world, local = int(os.environ.get("WORLD_SIZE", 1)), int(os.environ.get("LOCAL_RANK", 0))
    chosen = _device(device, local)
    if world == 1:
        yield DistributedContext(chosen, Ranks())
        return
    store, rank, _ = next(rendezvous("env://"))
    # After a restart torchrun (2.13) offers the store of the start before, where the address of a
    # killed rank may be found before its successor's. On one host each start has keys of its own;
    # hosts count restarts differently, see docs/guide/training.md.
    if os.environ.get("GROUP_WORLD_SIZE") == "1":
        start = os.environ.get("TORCHELASTIC_RESTART_COUNT", "0")
        store = PrefixStore(f"start {start}", store)
    backend = "nccl" if chosen.type == GPU else "gloo"
    torch.distributed.init_process_group(backend, store=store, rank=rank, world_size=world)
    context = DistributedContext(chosen, Ranks(rank, world))
    try:
        yield context
        # torchrun stops the leader, which may still write, if another rank aborts. The last wait
        # has a group of its own: destroying it joins its threads, one of which could otherwise
        # abort the ending process. The default group's live on: DistributedDataParallel refers
        # to it for good.
        last = torch.distributed.new_group()
        assert isinstance(last, torch.distributed.ProcessGroup)  # every rank is a member
        torch.distributed.barrier(last)
        torch.distributed.destroy_process_group(last)
    finally:
        torch.distributed.destroy_process_group()


def _device(name: str, local_rank: int) -> torch.device:
    if name == "auto":
        name = default_device()
    if name == GPU:
        name = f"{GPU}:{local_rank}"
    device = device_named(name)
    if device.type == GPU:
        torch.cuda.set_device(device)
    return device


# The weight, its gradient, AdamW's two moments and the moving average, each of four bytes.
BYTES_OF_A_WEIGHT = 20

# Share of a device's memory that weights and optimizer may take on every rank; activations need the
# rest.
SHARE = 0.5

Module = TypeVar("Module", bound=nn.Module)


def is_sharded(network: nn.Module, settings: TrainingSettings, context: DistributedContext) -> bool:
    """Returns whether the ranks share the weights of a network, or each holds all.

    Args:
        network: Network to train.
        settings: By `auto` it is shared where it takes more than `SHARE` of a GPU's memory.
        context: The device; one rank shares nothing.
    """
    if context.ranks.world == 1 or settings.parallel == "replicated":
        return False
    needed = BYTES_OF_A_WEIGHT * sum(weights.numel() for weights in network.parameters())
    return settings.parallel == "sharded" or needed > SHARE * device_memory(context.device)


def device_memory(device: torch.device) -> float:
    """Returns the bytes of a GPU's memory; of a processor's, no limit is known."""
    if device.type != GPU:
        return float("inf")
    return float(torch.cuda.get_device_properties(device).total_memory)


def shard(module: nn.Module, network: nn.Module, context: DistributedContext) -> None:
    """Leaves each rank its part of a network: of every layer of a list, and of the rest.

    Args:
        module: Whose forward uses the network; the network itself, or what holds it.
        network: Network whose weights are sharded. Other weights of `module` stay whole.
        context: The ranks.
    """
    from torch.distributed.fsdp import fully_shard  # most of a second

    mesh = init_device_mesh(context.device.type, (context.ranks.world,))
    lists = (part for part in reversed(list(network.modules())) if isinstance(part, nn.ModuleList))
    layers = [layer for part in lists for layer in part if not isinstance(layer, nn.ModuleList)]
    for layer in dict.fromkeys(layers):
        fully_shard(layer, mesh=mesh)
    others = set(module.parameters()) - set(network.parameters())
    fully_shard(module, mesh=mesh, ignored_params=others)


def whole(state: Any) -> Any:
    """Returns a tree with shared tensors put together on the host; every rank must call it."""
    if isinstance(state, dict):
        return {key: whole(value) for key, value in state.items()}
    if isinstance(state, list):
        return [whole(value) for value in state]
    return state.full_tensor().cpu() if hasattr(state, "full_tensor") else state


def shared_like(tensor: torch.Tensor, example: torch.Tensor) -> torch.Tensor:
    """Returns a whole tensor laid out as `example` is: sharded over the ranks, or whole."""
    if not hasattr(example, "full_tensor"):
        return tensor
    from torch.distributed.tensor import distribute_tensor

    mesh, placements = example.device_mesh, example.placements  # type: ignore[attr-defined]
    tensor = tensor.to(mesh.device_type)
    # Each rank has all of it, so that nothing is sent.
    return distribute_tensor(tensor, mesh, placements, src_data_rank=None)
