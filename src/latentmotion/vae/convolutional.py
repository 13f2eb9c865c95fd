"""A VAE of 1-D convolutions whose latents keep the time axis, at a quarter of the frame rate.

    features (T, 263) → width 256 at T → T/2 → T/4 → latents (T/4, 16), and back

It is not the paper's: it learns the same motions some ten times faster from little data, and its
latents can be edited, joined and streamed. A length that is no multiple of four is padded inside
and cropped. The way back is a part of its own, so that latents may get another, cheaper one.
"""

from __future__ import annotations

import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from latentmotion.model.vae_config import STRIDE
from latentmotion.vae.convolutions import Chain, as_row, pyramid
from latentmotion.vae.interface import MotionVAE
from latentmotion.vae.posterior import Posterior

MAX_LOGVAR = 8.0
"""Bound on the posterior's log variance; a rare motion far off the mean once made it infinite."""


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
