"""What the encoder says of a motion: a diagonal normal distribution of its latents."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


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

    def divergence(self) -> Float[Tensor, "batch tokens width"]:
        """Returns KL(q ‖ N(0, 1)) of each latent number, in nats."""
        return 0.5 * (self.mean**2 + self.logvar.exp() - 1 - self.logvar)
