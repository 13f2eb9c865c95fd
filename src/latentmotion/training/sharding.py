"""Fully sharded training (FSDP): each rank holds a part of the weights, gradients and moments.

A layer's weights are gathered where it is computed. What is written is whole, so that a run goes on
with any number of ranks, sharded or replicated.
"""

from __future__ import annotations

from typing import Any, TypeVar

import torch
from torch import nn
from torch.distributed.device_mesh import init_device_mesh

from latentmotion.gpu.device import GPU
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import TrainingSettings

BYTES_OF_A_WEIGHT = 20
"""The weight, its gradient, AdamW's two moments and the moving average, each of four bytes."""

SHARE = 0.5
"""Share of a device's memory that weights and optimizer may take on every rank; activations need
the rest."""

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
