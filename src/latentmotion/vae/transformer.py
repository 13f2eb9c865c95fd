"""The paper's VAE (section 3.1): a motion of any length becomes n tokens, and they a motion.

    encode:  [learned tokens, frames] + positions → encoder → its first outputs → mean, logvar
    decode:  zeros + positions, looking at z → decoder → frames

A narrower latent (MotionLCM, Dai et al. 2024) has a learned linear map on each side of it.

ACTOR's VAE (Petrovich et al. 2021) is the same chain without skips, with sine positions.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.vae.frame_decoders import all_real
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
