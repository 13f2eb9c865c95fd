"""Embeddings of positions and of timesteps.

A position embedding is learned, as in the paper, or a sine: p[i, 2k] = sin(i · 10000^(-2k/width)),
p[i, 2k+1] = cos(same) (Vaswani et al. 2017, section 3.5). Timesteps use sines alone.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from latentmotion.networks.attention import Dropout

LEARNED_LENGTH = 500
"""Longest sequence of a learned table, the authors' limit."""


class LearnedPosition(nn.Module):
    """A table learned in training."""

    def __init__(self, width: int, length: int = LEARNED_LENGTH) -> None:
        super().__init__()
        self.table = nn.Parameter(torch.rand(length, width))

    def forward(
        self, x: Float[Tensor, "batch tokens width"], start: int | torch.SymInt = 0
    ) -> Float[Tensor, "batch tokens width"]:
        """Adds the positions start, start + 1, ..."""
        return x + self.table[start : start + x.shape[1]]


class SinePosition(nn.Module):
    """Fixed sines, with dropout on the sum as in ACTOR (Petrovich et al. 2021).

    They are computed for the positions that are asked for, so that no table limits the length or
    fills an exported graph.
    """

    rate: Tensor

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.register_buffer("rate", sine_rate(width), persistent=False)
        self.dropout = Dropout(dropout)

    def forward(
        self, x: Float[Tensor, "batch tokens width"], start: int | torch.SymInt = 0
    ) -> Float[Tensor, "batch tokens width"]:
        """Adds the positions start, start + 1, ..."""
        positions: Tensor = torch.arange(x.shape[1], device=x.device) + start  # type: ignore
        return self.dropout(x + sines(positions, self.rate))


def sines(
    positions: Int[Tensor, " tokens"], rate: Float[Tensor, " half"]
) -> Float[Tensor, "tokens width"]:
    """Returns what the positions add."""
    angles = positions[:, None] * rate
    return torch.stack([torch.sin(angles), torch.cos(angles)], dim=-1).flatten(1)


def sine_rate(width: int) -> Float[Tensor, " half"]:
    """Returns 10000^(-2k/width)."""
    return torch.exp(torch.arange(0, width, 2) * (-math.log(10_000.0) / width))


class NumberEmbedding(nn.Module):
    """One token per number.

    Args:
        sine_width: Width of the sinusoid, even.
        width: Width of the token.
        scale: Multiplies the number first: a time in 0 .. 1 wants 1000, so that it varies as much
            as the discrete times 0 .. 999.
    """

    def __init__(self, sine_width: int, width: int, scale: float = 1.0) -> None:
        super().__init__()
        self.sine_width = sine_width
        self.scale = scale
        self.network = nn.Sequential(
            nn.Linear(sine_width, width), nn.SiLU(), nn.Linear(width, width)
        )

    def forward(self, number: Float[Tensor, " batch"]) -> Float[Tensor, "batch width"]:
        """Returns the tokens."""
        return self.network(sinusoid(number * self.scale, self.sine_width))


def sinusoid(number: Float[Tensor, " batch"], width: int) -> Float[Tensor, "batch width"]:
    """Returns the cosines, then the sines, of the number at falling frequencies."""
    half = width // 2
    steps = torch.arange(half, dtype=torch.float32, device=number.device)
    angles = number[:, None] * torch.exp(-math.log(10_000.0) / half * steps)
    return torch.cat([torch.cos(angles), torch.sin(angles)], dim=-1)
