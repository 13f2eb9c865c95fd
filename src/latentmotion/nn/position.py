"""Where a token stands in its sequence, added to what it holds.

Learned (as in the paper) or sine: p[i, 2k] = sin(i · 10000^(-2k/width)), p[i, 2k+1] = cos(same)
(Vaswani et al. 2017, section 3.5).
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from latentmotion.nn.dropout import Dropout

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

    They are computed for the places that are asked for, so that no table limits the length or
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
        places: Tensor = torch.arange(x.shape[1], device=x.device) + start  # type: ignore
        return self.dropout(x + sines(places, self.rate))


def sines(
    places: Int[Tensor, " tokens"], rate: Float[Tensor, " half"]
) -> Float[Tensor, "tokens width"]:
    """Returns what the places add."""
    angles = places[:, None] * rate
    return torch.stack([torch.sin(angles), torch.cos(angles)], dim=-1).flatten(1)


def sine_rate(width: int) -> Float[Tensor, " half"]:
    """Returns 10000^(-2k/width)."""
    return torch.exp(torch.arange(0, width, 2) * (-math.log(10_000.0) / width))
