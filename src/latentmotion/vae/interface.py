"""Motion to latents and back: what every motion VAE answers, whatever is inside it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.vae.posterior import Posterior


class MotionVAE(nn.Module, ABC):
    """A variational autoencoder of normalized motion features.

    The real frames of a mask come first. Padding never changes a real frame, and a batch of two
    motions is two batches of one; `eval()` makes everything but the posterior's draw
    deterministic.

    Attributes:
        latent_width: Numbers per latent token.
    """

    latent_width: int

    WAY_BACK: ClassVar[tuple[str, ...]] = ("decoder",)
    """Names of the modules that `decode` runs; what is left makes the latents."""

    @abstractmethod
    def encode(
        self,
        features: Float[Tensor, "batch frames features"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Posterior:
        """Returns the distribution of the latents, (batch, tokens, width).

        Args:
            features: Normalized features; what padding holds does not matter.
            mask: True on real frames.
        """

    @abstractmethod
    def decode(
        self,
        latents: Float[Tensor, "batch tokens width"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Float[Tensor, "batch frames features"]:
        """Returns normalized features, zero on padding.

        Args:
            latents: As `encode` gives them for as many frames.
            mask: True on real frames; says how long each motion shall be.
        """

    @abstractmethod
    def latent_mask(self, mask: Bool[Tensor, "batch frames"]) -> Bool[Tensor, "batch tokens"]:
        """Returns which latent tokens are real, from which frames are."""
