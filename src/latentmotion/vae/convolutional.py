"""A VAE of 1-D convolutions whose latents keep the time axis, at a quarter of the frame rate.

    features (T, 263) → width 256 at T → T/2 → T/4 → latents (T/4, 16), and mirrored back

It is not the paper's: it learns the same motions some ten times faster from little data, and its
latents can be edited, joined and streamed. After each convolution the padding is set to zero, which
is what a convolution sees beyond the ends of a motion alone, so padding can't leak. A length that
is no multiple of four is padded inside and cropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.vae.interface import MotionVAE
from latentmotion.vae.posterior import Posterior

STRIDE = 4
"""Frames per latent token."""


@dataclass(frozen=True)
class ConvolutionalVAEConfig:
    """Sizes of a `ConvolutionalVAE`."""

    features: int = 263
    """Numbers per frame."""
    width: int = 256
    """Channels inside."""
    channels: int = 16
    """Numbers per latent token."""
    dilations: tuple[int, ...] = (1, 3, 9)
    """Dilation of each residual block at half and at quarter rate."""

    def build(self) -> ConvolutionalVAE:
        """Builds the network with fresh weights."""
        return ConvolutionalVAE(self.features, self.width, self.channels, self.dilations)


class ConvolutionalVAE(MotionVAE):
    """Residual convolutions with two halvings of the frame rate, and two doublings."""

    def __init__(
        self, features: int, width: int, channels: int, dilations: tuple[int, ...]
    ) -> None:
        super().__init__()
        self.latent_width = channels
        self.encoder = nn.ModuleList(
            [
                MaskedConvolution(features, width, 3),
                Halve(width),
                *(ResidualBlock(width, d) for d in dilations),
                Halve(width),
                *(ResidualBlock(width, d) for d in dilations),
                MaskedConvolution(width, 2 * channels, 3, activation=nn.SiLU()),
            ]
        )
        self.decoder = nn.ModuleList(
            [
                MaskedConvolution(channels, width, 3),
                *(ResidualBlock(width, d) for d in reversed(dilations)),
                Double(width),
                *(ResidualBlock(width, d) for d in reversed(dilations)),
                Double(width),
                MaskedConvolution(width, width, 3, activation=nn.SiLU()),
                MaskedConvolution(width, features, 3, activation=nn.SiLU()),
            ]
        )

    def encode(
        self,
        features: Float[Tensor, "batch frames features"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Posterior:
        """Returns the distribution of ceil(frames / 4) latent tokens."""
        masks = _pyramid(mask)
        padding = masks[0].shape[1] - mask.shape[1]
        x = F.pad(features, (0, 0, 0, padding)).transpose(1, 2) * _row(masks[0])
        mean, logvar = _run(self.encoder, x, masks).transpose(1, 2).chunk(2, dim=-1)
        return Posterior(mean, logvar)

    def decode(
        self,
        latents: Float[Tensor, "batch tokens width"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Float[Tensor, "batch frames features"]:
        """Returns features of as many frames as the mask has."""
        masks = _pyramid(mask)
        x = latents.transpose(1, 2) * _row(masks[-1])
        return _run(self.decoder, x, masks[::-1]).transpose(1, 2)[:, : mask.shape[1]]

    def latent_mask(self, mask: Bool[Tensor, "batch frames"]) -> Bool[Tensor, "batch tokens"]:
        """Returns True for a token whose first frame is real."""
        return mask[:, ::STRIDE]


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


def _pyramid(mask: Tensor) -> list[Tensor]:
    """Masks at full, half and quarter rate, padded to a multiple of `STRIDE` frames."""
    full = F.pad(mask, (0, -mask.shape[1] % STRIDE))
    return [full, full[:, ::2], full[:, ::4]]


def _row(mask: Tensor) -> Tensor:
    return mask[:, None, :].float()


def _run(layers: nn.ModuleList, x: Tensor, masks: list[Tensor]) -> Tensor:
    """Applies the layers, each with the mask of the rate that it leaves."""
    rate = 0
    for layer in layers:
        rate += layer.rate_change  # type: ignore[operator]
        x = layer(x, _row(masks[rate]))
    return x
