"""VAEs of the paper's baselines: VPoser over time (table 4), and none at all.

    encode:  frames × features → norm → 512, leaky ReLU → norm → 512 → 512 → mean and deviation
    decode:  256 → 512 → 512 → frames × features

It has one fixed length. A shorter motion repeats its last frame, so what its padding holds
changes nothing; a longer one is refused. In training the motions of a batch normalize each other
(BatchNorm), so a batch of two is two batches of one only in `eval()`.

So diffusion on raw frames, the paper's "MLD without VAE" and MDM, is stage 2 like any other.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.model.config import VPoserTConfig
from latentmotion.networks.vae.interface import MotionVAE, Posterior

LEAST_DEVIATION = 1e-8
"""Keeps the logarithm of a vanishing deviation finite."""


class VPoserT(MotionVAE):
    """Layers from the flattened motion to one latent token, and back."""

    def __init__(self, config: VPoserTConfig) -> None:
        super().__init__()
        self.config = config
        self.latent_width = config.width
        numbers, hidden = config.frames * config.features, config.hidden
        self.encoder = nn.Sequential(
            nn.BatchNorm1d(numbers),
            nn.Linear(numbers, hidden),
            nn.LeakyReLU(),
            nn.BatchNorm1d(hidden),
            nn.Dropout(config.dropout),
            nn.Linear(hidden, hidden),
            nn.Linear(hidden, hidden),
        )
        self.mean = nn.Linear(hidden, self.latent_width)
        self.deviation = nn.Sequential(nn.Linear(hidden, self.latent_width), nn.Softplus())
        self.decoder = nn.Sequential(
            nn.Linear(self.latent_width, hidden),
            nn.LeakyReLU(),
            nn.Dropout(config.dropout),
            nn.Linear(hidden, hidden),
            nn.LeakyReLU(),
            nn.Linear(hidden, numbers),
            nn.Unflatten(1, (config.frames, config.features)),
        )

    def encode(
        self,
        features: Float[Tensor, "batch frames features"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Posterior:
        """Returns the distribution of the one latent token.

        Raises:
            InputError: The motions are longer than the one length, or one alone is trained on.
        """
        self.config.check(mask.shape[1])
        if self.training:
            self.config.check_batch(len(mask))
        last = mask.sum(dim=1, keepdim=True) - 1  # repeated to the one length
        frames = torch.arange(self.config.frames, device=mask.device).minimum(last)
        whole = features.gather(1, frames[..., None].expand(-1, -1, features.shape[2]))
        h = self.encoder(whole.flatten(1))[:, None]
        deviation = self.deviation(h).float().clamp(min=LEAST_DEVIATION)
        return Posterior(self.mean(h), 2 * deviation.log())

    def decode(
        self,
        latents: Float[Tensor, "batch tokens width"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Float[Tensor, "batch frames features"]:
        """Returns the first frames of the one length.

        Raises:
            InputError: The mask is longer than the one length.
        """
        self.config.check(mask.shape[1])
        return self.decoder(latents[:, 0])[:, : mask.shape[1]] * mask[..., None]

    def latent_mask(self, mask: Bool[Tensor, "batch frames"]) -> Bool[Tensor, "batch tokens"]:
        """Returns True for the one token."""
        return mask.new_ones(mask.shape[0], 1)


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
