"""Weights in 8 bits: each row w of a matrix is kept as integers q and one scale s, w ≈ s · q.

Only storage shrinks, by four; arithmetic stays in float32. The rounding error of a weight is at
most half of s = max |w| / 127.
"""

from __future__ import annotations

import copy

import torch
from jaxtyping import Float, Int
from torch import nn
from torch.nn import functional as F


class PackedLinear(nn.Module):
    """`nn.Linear` with its matrix in 8 bits."""

    packed: torch.Tensor
    scale: torch.Tensor
    bias: torch.Tensor

    def __init__(self, linear: nn.Linear) -> None:
        super().__init__()
        packed, scale = pack(linear.weight.detach())
        self.register_buffer("packed", packed)
        self.register_buffer("scale", scale)
        self.register_buffer("bias", linear.bias.detach().clone())

    def forward(self, inputs: Float[torch.Tensor, "*batch width"]) -> torch.Tensor:
        """Returns the linear map of `inputs`."""
        return F.linear(inputs, self.packed.to(inputs.dtype) * self.scale, self.bias)


class PackedEmbedding(nn.Module):
    """`nn.Embedding` with its table in 8 bits."""

    packed: torch.Tensor
    scale: torch.Tensor

    def __init__(self, embedding: nn.Embedding) -> None:
        super().__init__()
        packed, scale = pack(embedding.weight.detach())
        self.register_buffer("packed", packed)
        self.register_buffer("scale", scale)

    def forward(self, tokens: Int[torch.Tensor, "*batch"]) -> torch.Tensor:
        """Returns one row of the table per token."""
        return self.packed[tokens].to(self.scale.dtype) * self.scale[tokens]


def pack(
    weight: Float[torch.Tensor, "rows width"],
) -> tuple[Int[torch.Tensor, "rows width"], Float[torch.Tensor, "rows 1"]]:
    """Returns (integers, scales) of a matrix; a row of zeros stays zeros."""
    scale = (weight.abs().amax(dim=1, keepdim=True) / 127).clamp_min(1e-12)
    return (weight / scale).round().to(torch.int8), scale


def packed(network: nn.Module) -> nn.Module:
    """Returns a copy of a network with every linear map and table in 8 bits."""
    small = copy.deepcopy(network).eval()
    for module in list(small.modules()):
        for name, child in module.named_children():
            if isinstance(child, nn.Linear):
                setattr(module, name, PackedLinear(child))
            elif isinstance(child, nn.Embedding):
                setattr(module, name, PackedEmbedding(child))
    return small
