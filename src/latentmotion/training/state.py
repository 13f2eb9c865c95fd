"""The state of a training run: moving average of the weights, and snapshots.

The average is ē ← d ē + (1 − d) θ, with d growing at the start. A snapshot holds all that a killed
run needs to resume, in one file that is whole or absent: weights, their average, the optimizer's
moments and the number of steps done. The position in the data and the state of every random
generator follow from that number (`rng.py`).
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import nn

from latentmotion.errors import ModelError
from latentmotion.model.version_1 import upgraded_weights
from latentmotion.storage.files import atomic_file

Network = TypeVar("Network", bound=nn.Module)


class ExponentialMovingAverage(Generic[Network]):
    """A smoothed copy of a network, which is what is validated, sampled from and saved.

    The decay at step k is min(decay, (1 + k) / (10 + k)), so that the random first weights are
    forgotten at once (as in TensorFlow's `ExponentialMovingAverage`).

    Args:
        network: The network to follow; it is copied.
        decay: d for large k; 0 makes the average equal to the network.
    """

    def __init__(self, network: Network, decay: float) -> None:
        self.network = copy.deepcopy(network).eval().requires_grad_(False)
        self.decay = decay

    @torch.no_grad()
    def update(self, network: Network, step: int) -> None:
        """Moves the average towards `network` after optimizer step number `step`, from 0."""
        weight = 1 - min(self.decay, (1 + step) / (10 + step))
        mine, others = self.network.state_dict(), network.state_dict()
        for name, tensor in mine.items():
            if tensor.is_floating_point():  # weights, and the running statistics that fit them
                tensor.lerp_(others[name], weight)
            else:
                tensor.copy_(others[name])


NAME = "snapshot.pt"


def save_snapshot(
    folder: Path,
    step: int,
    network: nn.Module,
    average: ExponentialMovingAverage,
    optimizer: torch.optim.Optimizer,
    seconds: float,
) -> None:
    """Writes the snapshot of `folder` after `step` steps and `seconds` of training."""
    state = {
        "step": step,
        "seconds": seconds,
        "network": network.state_dict(),
        "average": average.network.state_dict(),
        "optimizer": optimizer.state_dict(),
    }
    with atomic_file(folder / NAME) as temporary:
        torch.save(state, temporary)


def load_snapshot(
    folder: Path,
    network: nn.Module,
    average: ExponentialMovingAverage,
    optimizer: torch.optim.Optimizer,
) -> tuple[int, float]:
    """Restores what `save_snapshot` wrote; returns (steps, seconds) done, zeros without one.

    Raises:
        ModelError: The file is damaged or belongs to other networks.
    """
    path = folder / NAME
    if not path.exists():
        return 0, 0.0
    state = _read(path)
    try:
        network.load_state_dict(upgraded_weights(state["network"]))
        average.network.load_state_dict(upgraded_weights(state["average"]))
        optimizer.load_state_dict(state["optimizer"])
    except (KeyError, RuntimeError, ValueError) as error:
        raise ModelError(
            f"{path} does not fit this network: {error}; use another folder"
        ) from error
    return state["step"], state["seconds"]


def _read(path: Path) -> dict[str, Any]:
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise ModelError(f"{path} is damaged: {error}; delete it to start afresh") from error
