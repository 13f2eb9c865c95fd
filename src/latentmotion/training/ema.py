"""Exponential moving average of the weights: ē ← d ē + (1 − d) θ, with d growing at the start."""

from __future__ import annotations

import copy
from typing import Generic, TypeVar

import torch
from torch import nn

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
