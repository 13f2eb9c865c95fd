"""No VAE: the latents are the normalized frames themselves, known without doubt.

So diffusion on raw frames, the paper's "MLD without VAE" and MDM, is stage 2 like any other.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from latentmotion.networks.vae.interface import MotionVAE, Posterior


class IdentityVAE(MotionVAE):
    """One latent token per frame, which is the frame, with a deviation of 0."""

    DECODER_MODULES = ()

    def __init__(self, features: int) -> None:
        super().__init__()
        self.latent_width = features

    def encode(
        self,
        features: Float[Tensor, "batch frames features"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Posterior:
        """Returns the real frames as means, with the logarithm of a variance of 0."""
        return Posterior(features * mask[..., None], torch.full_like(features, -torch.inf))

    def decode(
        self,
        latents: Float[Tensor, "batch tokens width"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Float[Tensor, "batch frames features"]:
        """Returns the latents, zero on padding."""
        return latents * mask[..., None]

    def latent_mask(self, mask: Bool[Tensor, "batch frames"]) -> Bool[Tensor, "batch tokens"]:
        """Returns the mask itself."""
        return mask
