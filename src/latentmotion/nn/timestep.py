"""A number (the time of the diffusion, the length of a motion) as a token.

e(t) = [cos(t f), sin(t f)] with f_i = 10000^(-i / half), then linear, SiLU, linear.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn


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
