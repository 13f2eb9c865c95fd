"""How many numbers a network has learned."""

from __future__ import annotations

from torch import nn


def parameters(network: nn.Module) -> int:
    """Returns the number of parameters; buffers, which are not learned, do not count."""
    return sum(parameter.numel() for parameter in network.parameters())
