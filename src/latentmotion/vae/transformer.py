"""The paper's VAE (section 3.1): a motion of any length becomes n tokens, and they a motion.

    encode:  [learned tokens, frames] + positions → encoder → its first outputs → mean, logvar
    decode:  zeros + positions, looking at z → decoder → frames

A narrower latent (MotionLCM, Dai et al. 2024) has a learned linear map on each side of it.

ACTOR's VAE (Petrovich et al. 2021) is the same chain without skips, with sine positions.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.nn.position import PositionKind, build_position
from latentmotion.nn.transformer import TransformerConfig
from latentmotion.vae.frame_decoders import (
    STRIDE,
    CrossDecoder,
    JointDecoder,
    TwoRateDecoder,
    all_real,
)
from latentmotion.vae.interface import MotionVAE
from latentmotion.vae.posterior import Posterior


class TransformerVAE(MotionVAE):
    """A VAE with a fixed number of latent tokens for the whole motion.

    Args:
        frames_in: Features of a frame to the width of the transformer.
        frames_out: And back.
        summary: Learned tokens, (count, width), whose outputs tell the posterior.
        place: Adds positions to the encoder's sequence.
        encoder: Called with (x, mask).
        distribution: Summary outputs to a `Posterior`.
        decoder: Latents and mask to outputs per frame.
        tokens: Number of latent tokens.
        narrow: Summary outputs to the width of the latents.
        widen: Latents to the width of the transformer.
        latent_width: Numbers per latent token.
    """

    WAY_BACK = ("widen", "decoder", "frames_out")

    def __init__(
        self,
        frames_in: nn.Module,
        frames_out: nn.Module,
        summary: Float[Tensor, "count width"],
        place: nn.Module,
        encoder: nn.Module,
        distribution: nn.Module,
        decoder: nn.Module,
        tokens: int,
        narrow: nn.Module,
        widen: nn.Module,
        latent_width: int,
    ) -> None:
        super().__init__()
        self.frames_in = frames_in
        self.frames_out = frames_out
        self.summary = nn.Parameter(summary)
        self.place = place
        self.encoder = encoder
        self.distribution = distribution
        self.decoder = decoder
        self.tokens = tokens
        self.narrow = narrow
        self.widen = widen
        self.latent_width = latent_width

    def encode(
        self,
        features: Float[Tensor, "batch frames features"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Posterior:
        """Returns the distribution of the latent tokens."""
        summary = self.summary.expand(features.shape[0], -1, -1)
        x = self.place(torch.cat([summary, self.frames_in(features)], dim=1))
        x = self.encoder(x, torch.cat([all_real(summary), mask], dim=1))
        return self.distribution(self.narrow(x[:, : summary.shape[1]]))

    def decode(
        self,
        latents: Float[Tensor, "batch tokens width"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Float[Tensor, "batch frames features"]:
        """Returns features of as many frames as the mask has."""
        return self.frames_out(self.decoder(self.widen(latents), mask)) * mask[..., None]

    def latent_mask(self, mask: Bool[Tensor, "batch frames"]) -> Bool[Tensor, "batch tokens"]:
        """Returns True for every token: each stands for the whole motion."""
        return mask.new_ones(mask.shape[0], self.tokens)


class TokenDistribution(nn.Module):
    """The first half of the summary tokens is the mean, the other half the logvar."""

    def forward(self, summary: Float[Tensor, "batch count width"]) -> Posterior:
        """Returns the posterior of count / 2 tokens."""
        return Posterior(*summary.chunk(2, dim=1))


class LinearDistribution(nn.Module):
    """A linear layer makes mean and logvar from each summary token (the authors' MLP_DIST)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.linear = nn.Linear(width, 2 * width)

    def forward(self, summary: Float[Tensor, "batch count width"]) -> Posterior:
        """Returns the posterior of count tokens."""
        return Posterior(*self.linear(summary).chunk(2, dim=-1))


@dataclass(frozen=True)
class TransformerVAEConfig:
    """Which parts a `TransformerVAE` has; the defaults are the paper's MLD-1."""

    features: int = 263
    """Numbers per frame."""
    tokens: int = 1
    """Latent tokens of a motion."""
    transformer: TransformerConfig = field(default_factory=TransformerConfig)
    """The stack inside, the same for encoder and decoder."""
    position: PositionKind = "learned"
    """Kind of position tables."""
    distribution: Literal["tokens", "linear"] = "tokens"
    """Whether mean and logvar have tokens of their own or come from a linear layer."""
    decoding: Literal["cross", "joint", "two_rate"] = "cross"
    """Whether frames look at the latents by cross-attention, share a sequence with them, or do the
    first in most layers at a quarter of the frame rate."""
    fine_layers: int = 2
    """Layers of a decoder of two rates that see every frame; there are as many fewer coarse ones.
    """
    latent_width: int | None = None
    """Numbers per latent token; by default as many as the transformer has."""

    def build(self) -> TransformerVAE:
        """Builds the network with fresh weights."""
        width, latent = self.transformer.width, self.latent_width or self.transformer.width
        adapted = self.latent_width is not None
        own_tokens = self.distribution == "tokens"
        return TransformerVAE(
            frames_in=nn.Linear(self.features, width),
            frames_out=nn.Linear(width, self.features),
            summary=torch.randn(self.tokens * (2 if own_tokens else 1), width),
            place=self._place(),
            encoder=self.transformer.encoder(),
            distribution=TokenDistribution() if own_tokens else LinearDistribution(latent),
            decoder=self._decoder(),
            tokens=self.tokens,
            narrow=nn.Linear(width, latent) if adapted else nn.Identity(),
            widen=nn.Linear(latent, width) if adapted else nn.Identity(),
            latent_width=latent,
        )

    def cheaper(self) -> TransformerVAEConfig:
        """Returns the same latents with the decoder that costs least."""
        return replace(self, decoding="two_rate")

    def _place(self) -> nn.Module:
        return build_position(self.position, self.transformer.width, self.transformer.dropout)

    def _decoder(self) -> nn.Module:
        if self.decoding == "joint":
            return JointDecoder(self._place(), self.transformer.encoder())
        if self.decoding == "two_rate":
            return self._two_rates()
        return CrossDecoder(self._place(), self.transformer.decoder())

    def _two_rates(self) -> TwoRateDecoder:
        whole, fine = self.transformer, self.fine_layers
        return TwoRateDecoder(
            place=self._place(),
            coarse=replace(whole, layers=whole.layers - fine).decoder(),
            unfold=nn.Linear(whole.width, STRIDE * whole.width),
            fine=replace(whole, layers=fine, skips=False).decoder(),
        )
