"""Convolutions at three frame rates, which a `ConvolutionalVAE` is made of.

After each the padding is set to zero, which is what a convolution sees beyond the ends of a motion
alone, so padding can't leak.
"""

from __future__ import annotations

import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.model.vae_config import STRIDE


class Chain(nn.ModuleList):
    """Layers one after the other, each with the mask of the rate that it leaves."""

    def forward(self, x: Tensor, masks: list[Tensor]) -> Tensor:
        """Returns what the last layer makes, (batch, channels, steps).

        Args:
            x: Input of the first layer, (batch, channels, steps).
            masks: True on real steps, at the rate of `x` and at those that follow.
        """
        rate = 0
        for layer in self:
            rate += layer.rate_change  # type: ignore[operator]
            x = layer(x, as_row(masks[rate]))
        return x


class MaskedConvolution(nn.Module):
    """Convolution that keeps the length, and zeroes the padding."""

    rate_change = 0

    def __init__(
        self, inputs: int, outputs: int, kernel: int, activation: nn.Module | None = None
    ) -> None:
        super().__init__()
        self.activation = activation or nn.Identity()
        self.convolution = nn.Conv1d(inputs, outputs, kernel, padding=kernel // 2)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns (batch, outputs, frames)."""
        return self.convolution(self.activation(x)) * row


class ResidualBlock(nn.Module):
    """x + what a dilated and a pointwise convolution find in it."""

    rate_change = 0

    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.dilated = nn.Conv1d(width, width, 3, padding=dilation, dilation=dilation)
        self.pointwise = nn.Conv1d(width, width, 1)
        nn.init.zeros_(self.pointwise.weight)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns the same shape; SiLU of zero is zero, so only the bias needs masking."""
        return x + self.pointwise(F.silu(self.dilated(F.silu(x)))) * row


class Halve(nn.Module):
    """Convolution with stride 2."""

    rate_change = 1

    def __init__(self, width: int) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(width, width, 4, stride=2, padding=1)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns half the length."""
        return self.convolution(x) * row


class Double(nn.Module):
    """Every step twice, then a convolution that smooths the stairs."""

    rate_change = 1

    def __init__(self, width: int) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(width, width, 3, padding=1)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns twice the length."""
        return self.convolution(x[..., None].expand(-1, -1, -1, 2).flatten(2) * row) * row


class Unfold(nn.Module):
    """Convolution at a quarter of the frame rate that makes a step's four frames at once.

    Shi et al. 2016 have it for pixels, as the sub-pixel convolution.
    """

    rate_change = 2

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(inputs, STRIDE * outputs, 3, padding=1)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns four times the length."""
        frames = self.convolution(F.silu(x)).unflatten(1, (STRIDE, -1))
        return frames.permute(0, 2, 3, 1).flatten(2) * row


def pyramid(mask: Bool[Tensor, "batch frames"]) -> list[Tensor]:
    """Returns masks at full, half and quarter rate, padded to a multiple of `STRIDE` frames."""
    full = F.pad(mask, (0, -mask.shape[1] % STRIDE))
    return [full, full[:, ::2], full[:, ::4]]


def as_row(mask: Bool[Tensor, "batch steps"]) -> Float[Tensor, "batch 1 steps"]:
    """Returns what a layer multiplies its output with."""
    return mask[:, None, :].float()
