"""The interface of every motion VAE, its posterior, and its split into encoder and decoder.

Two VAEs with the same encoder weights have the same latents, so one denoiser fits both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from hashlib import sha256
from itertools import takewhile
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn


@dataclass(frozen=True)
class Posterior:
    """q(z | motion) = N(mean, exp(logvar))."""

    mean: Float[Tensor, "batch tokens width"]
    """Mean of each latent number."""
    logvar: Float[Tensor, "batch tokens width"]
    """Logarithm of its variance."""

    @property
    def std(self) -> Float[Tensor, "batch tokens width"]:
        """Standard deviation of each latent number."""
        return torch.exp(0.5 * self.logvar)

    def sample(
        self, generator: torch.Generator | None = None
    ) -> Float[Tensor, "batch tokens width"]:
        """Draws latents, differentiable in mean and logvar (paper, section 3.1).

        Args:
            generator: Source of randomness on the CPU, so that a seed means the same everywhere.
        """
        noise = torch.randn(self.mean.shape, generator=generator, dtype=self.mean.dtype)
        return self.mean + self.std * noise.to(self.mean.device)

    def kl(self) -> Float[Tensor, "batch tokens width"]:
        """Returns KL(q ‖ N(0, 1)) of each latent number, in nats."""
        return 0.5 * (self.mean**2 + self.logvar.exp() - 1 - self.logvar)


class MotionVAE(nn.Module, ABC):
    """A variational autoencoder of normalized motion features.

    The real frames of a mask come first. Padding never changes a real frame, and a batch of two
    motions is two batches of one; `eval()` makes everything but the posterior's draw
    deterministic.

    Attributes:
        latent_width: Numbers per latent token.
    """

    latent_width: int

    DECODER_MODULES: ClassVar[tuple[str, ...]] = ("decoder",)
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
            mask: True on real frames; sets the length of each motion.
        """

    @abstractmethod
    def latent_mask(self, mask: Bool[Tensor, "batch frames"]) -> Bool[Tensor, "batch tokens"]:
        """Returns which latent tokens are real, from which frames are."""


def decoder_modules(vae: MotionVAE) -> nn.ModuleDict:
    """Returns the modules that turn latents into features, by name."""
    return nn.ModuleDict({name: getattr(vae, name) for name in vae.DECODER_MODULES})


def encoder_state(vae: MotionVAE) -> dict[str, Tensor]:
    """Returns all weights that make latents, by name."""
    weights = vae.state_dict().items()
    return {
        name: value for name, value in weights if name.partition(".")[0] not in vae.DECODER_MODULES
    }


def fingerprint(vae: MotionVAE) -> str:
    """Returns a hash of all weights that make latents; a zero has no sign in it."""
    found = sha256()
    for name, value in encoder_state(vae).items():
        found.update(name.encode() + (value + 0.0).cpu().contiguous().numpy().tobytes())
    return found.hexdigest()


def copy_encoder(vae: MotionVAE, trained: MotionVAE) -> None:
    """Gives `vae` the first half of a trained one, frozen, and of its way back what is alike.

    Alike are the weights from the latents on, up to where name or shape differs.
    """
    own, given = (decoder_modules(one).state_dict().items() for one in (vae, trained))
    pairs = takewhile(_are_alike, zip(own, given, strict=False))
    alike = {name: value for _, (name, value) in pairs}
    vae.load_state_dict({**vae.state_dict(), **encoder_state(trained), **alike})
    vae.requires_grad_(False)
    decoder_modules(vae).requires_grad_(True)


def _are_alike(pair: tuple[tuple[str, Tensor], tuple[str, Tensor]]) -> bool:
    (one, own), (other, given) = pair
    return one == other and own.shape == given.shape
