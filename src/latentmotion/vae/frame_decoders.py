"""Latents to outputs per frame, each frame a query that knows nothing but its place.

The paper's decoder, the authors' other one, and one that does most of its work at a quarter of the
frame rate.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

STRIDE = 4
"""Frames that a coarse query of `TwoRateDecoder` stands for."""


class CrossDecoder(nn.Module):
    """Positions as queries, which look at the latents by cross-attention."""

    def __init__(self, place: nn.Module, decoder: nn.Module) -> None:
        super().__init__()
        self.place = place
        self.decoder = decoder

    def forward(self, latents: Tensor, mask: Tensor) -> Tensor:
        """Returns (batch, frames, width)."""
        queries = self.place(_blank_frames(latents, mask))
        return self.decoder(queries, mask, latents, all_real(latents))


class JointDecoder(nn.Module):
    """Latents and positions in one sequence through an encoder (the authors' all_encoder)."""

    def __init__(self, place: nn.Module, encoder: nn.Module) -> None:
        super().__init__()
        self.place = place
        self.encoder = encoder

    def forward(self, latents: Tensor, mask: Tensor) -> Tensor:
        """Returns (batch, frames, width)."""
        x = self.place(torch.cat([latents, _blank_frames(latents, mask)], dim=1))
        x = self.encoder(x, torch.cat([all_real(latents), mask], dim=1))
        return x[:, latents.shape[1] :]


class TwoRateDecoder(nn.Module):
    """Coarse layers for every fourth frame; what they find unfolds into frames for the fine layers.

    Args:
        place: Adds positions to the coarse queries.
        coarse: Called with (x, mask, latents, mask of the latents) at a quarter of the frame rate.
        unfold: Width to four times as much.
        fine: Called likewise at the frame rate.
    """

    def __init__(
        self, place: nn.Module, coarse: nn.Module, unfold: nn.Module, fine: nn.Module
    ) -> None:
        super().__init__()
        self.place = place
        self.coarse = coarse
        self.unfold = unfold
        self.fine = fine

    def forward(self, latents: Tensor, mask: Tensor) -> Tensor:
        """Returns (batch, frames, width)."""
        real, frames = all_real(latents), mask.shape[1]
        steps = F.pad(mask, (0, -frames % STRIDE))[:, ::STRIDE]  #       (batch, frames / 4)
        x = self.coarse(self.place(_blank_frames(latents, steps)), steps, latents, real)
        x = self.unfold(x).unflatten(-1, (STRIDE, -1)).flatten(1, 2)  # (batch, frames, width)
        return self.fine(x[:, :frames], mask, latents, real)


def all_real(tokens: Tensor) -> Tensor:
    """Returns a mask of tokens none of which is padding."""
    return torch.ones_like(tokens[..., 0], dtype=torch.bool)


def _blank_frames(latents: Tensor, mask: Tensor) -> Tensor:
    return latents.new_zeros(*mask.shape, latents.shape[-1])
