"""A VAE of 1-D convolutions whose latents keep the time axis, at a quarter of the frame rate.

    features (T, 263) → width 256 at T → T/2 → T/4 → latents (T/4, 16), and back

It is not the paper's: it learns the same motions some ten times faster from little data, and its
latents can be edited, joined and streamed. A length that is no multiple of four is padded inside
and cropped. The way back is a part of its own, so that latents may get another, cheaper one.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.vae.convolutions import (
    STRIDE,
    Chain,
    Double,
    Halve,
    MaskedConvolution,
    ResidualBlock,
    Unfold,
    as_row,
    pyramid,
)
from latentmotion.vae.interface import MotionVAE
from latentmotion.vae.posterior import Posterior

MAX_LOGVAR = 8.0
"""Bound on the posterior's log variance; a rare motion far off the mean once made it infinite."""


@dataclass(frozen=True)
class MirroredDecoder:
    """The encoder's way back: T/4 → T/2 → T, at full width."""

    def build(self, sizes: ConvolutionalVAEConfig) -> Chain:
        """Builds it with fresh weights."""
        width, dilations = sizes.width, sizes.dilations[::-1]
        return Chain(
            [
                MaskedConvolution(sizes.channels, width, 3),
                *(ResidualBlock(width, d) for d in dilations),
                Double(width),
                *(ResidualBlock(width, d) for d in dilations),
                Double(width),
                MaskedConvolution(width, width, 3, activation=nn.SiLU()),
                MaskedConvolution(width, sizes.features, 3, activation=nn.SiLU()),
            ]
        )


@dataclass(frozen=True)
class QuarterRateDecoder:
    """Every layer at T/4, where a step costs a quarter of one at T; the last makes four frames."""

    dilations: tuple[int, ...] = (9, 3, 1, 1)
    """Dilation of each residual block; the first three are those of the mirrored decoder."""

    def build(self, sizes: ConvolutionalVAEConfig) -> Chain:
        """Builds it with fresh weights."""
        return Chain(
            [
                MaskedConvolution(sizes.channels, sizes.width, 3),
                *(ResidualBlock(sizes.width, d) for d in self.dilations),
                Unfold(sizes.width, sizes.features),
            ]
        )


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
    decoder: MirroredDecoder | QuarterRateDecoder = field(default_factory=MirroredDecoder)
    """The way back."""

    def build(self) -> ConvolutionalVAE:
        """Builds the network with fresh weights."""
        return ConvolutionalVAE(self._encoder(), self.decoder.build(self), self.channels)

    def cheaper(self) -> ConvolutionalVAEConfig:
        """Returns the same latents with the decoder that costs least."""
        return replace(self, decoder=QuarterRateDecoder())

    def _encoder(self) -> Chain:
        return Chain(
            [
                MaskedConvolution(self.features, self.width, 3),
                Halve(self.width),
                *(ResidualBlock(self.width, d) for d in self.dilations),
                Halve(self.width),
                *(ResidualBlock(self.width, d) for d in self.dilations),
                MaskedConvolution(self.width, 2 * self.channels, 3, activation=nn.SiLU()),
            ]
        )


class ConvolutionalVAE(MotionVAE):
    """Residual convolutions with two halvings of the frame rate, and a way back.

    Args:
        encoder: Features to mean and logvar of the latents, T → T/2 → T/4.
        decoder: Latents to features.
        channels: Numbers per latent token.
    """

    def __init__(self, encoder: Chain, decoder: Chain, channels: int) -> None:
        super().__init__()
        self.encoder = encoder
        self.decoder = decoder
        self.latent_width = channels

    def encode(
        self,
        features: Float[Tensor, "batch frames features"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Posterior:
        """Returns the distribution of ceil(frames / 4) latent tokens."""
        masks = pyramid(mask)
        padding = masks[0].shape[1] - mask.shape[1]
        x = F.pad(features, (0, 0, 0, padding)).transpose(1, 2) * as_row(masks[0])
        mean, logvar = self.encoder(x, masks).transpose(1, 2).chunk(2, dim=-1)
        return Posterior(mean, logvar.clamp(max=MAX_LOGVAR))

    def decode(
        self,
        latents: Float[Tensor, "batch tokens width"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Float[Tensor, "batch frames features"]:
        """Returns features of as many frames as the mask has."""
        masks = pyramid(mask)
        x = latents.transpose(1, 2) * as_row(masks[-1])
        return self.decoder(x, masks[::-1]).transpose(1, 2)[:, : mask.shape[1]]

    def latent_mask(self, mask: Bool[Tensor, "batch frames"]) -> Bool[Tensor, "batch tokens"]:
        """Returns True for a token whose first frame is real."""
        return mask[:, ::STRIDE]
