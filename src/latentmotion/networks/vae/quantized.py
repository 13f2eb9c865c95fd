"""A VAE whose latents are sums of codes: residual vector quantization, as in MoMask.

    features (T, 263) → width at T → T/2 → T/4 → codes (T/4, codebooks) → latents (T/4, channels)

A token becomes the nearest code of the first codebook, what is left of it the nearest of the next,
and so on; the latent is the sum, and nothing of it is drawn. The layers are those of MoMask's code
(Guo et al., CVPR 2024), whose checkpoints convert. Codebooks are not learned here.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from latentmotion.model.config import QuantizedVAEConfig
from latentmotion.networks.vae.convolutional import (
    Chain,
    ConvolutionalVAE,
    Double,
    Halve,
    MaskedConvolution,
    ResidualBlock,
)
from latentmotion.networks.vae.interface import Posterior


class _ReLU(nn.ReLU):
    rate_change = 0

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        return F.relu(x)


class QuantizedVAE(ConvolutionalVAE):
    """Convolutions around codebooks.

    Args:
        encoder: Features to one vector per token, T → T/2 → T/4.
        decoder: Sums of codes to features.
        codebooks: Codes of each codebook.
    """

    codebooks: Float[Tensor, "codebooks codes channels"]

    def __init__(
        self, encoder: Chain, decoder: Chain, codebooks: Float[Tensor, "codebooks codes channels"]
    ) -> None:
        super().__init__(encoder, decoder, codebooks.shape[2])
        self.register_buffer("codebooks", codebooks)

    @classmethod
    def of(cls, config: QuantizedVAEConfig) -> QuantizedVAE:  # type: ignore[override]
        """Builds the VAE of a configuration with fresh weights and codes."""
        width, channels, features = config.width, config.channels, config.features

        def blocks() -> Sequence[nn.Module]:
            return [ResidualBlock(width, dilation, F.relu) for dilation in config.dilations]

        into: list[nn.Module] = [MaskedConvolution(features, width, 3), _ReLU()]
        into += [Halve(width), *blocks(), Halve(width), *blocks()]
        back: list[nn.Module] = [MaskedConvolution(channels, width, 3), _ReLU()]
        back += [*blocks(), Double(width), *blocks(), Double(width)]
        last = MaskedConvolution(width, features, 3, activation=nn.ReLU())
        return cls(
            Chain([*into, MaskedConvolution(width, channels, 3)]),
            Chain([*back, MaskedConvolution(width, width, 3), last]),
            torch.randn(config.codebooks, config.codes, channels),
        )

    def encode(
        self, features: Float[Tensor, "batch frames features"], mask: Bool[Tensor, "batch frames"]
    ) -> Posterior:
        """Returns the sums of codes, without doubt; gradients pass by the codes."""
        x = self.encoded(features, mask)
        latents = x + (self.latents_of(self._nearest(x)) - x).detach()
        return Posterior(latents, torch.full_like(latents, float("-inf")))

    def indices(
        self, features: Float[Tensor, "batch frames features"], mask: Bool[Tensor, "batch frames"]
    ) -> Int[Tensor, "batch tokens codebooks"]:
        """Returns the number of the code of each codebook; those of padding mean nothing."""
        return self._nearest(self.encoded(features, mask))

    def latents_of(
        self, indices: Int[Tensor, "batch tokens some"]
    ) -> Float[Tensor, "batch tokens channels"]:
        """Returns the sums of codes of the first codebooks; fewer than all make it coarse."""
        codes = [book[one] for book, one in zip(self.codebooks, indices.unbind(-1), strict=False)]
        return torch.stack(codes).sum(dim=0)

    def _nearest(self, x: Tensor) -> Tensor:
        indices = []
        for book in self.codebooks:
            distances = book.square().sum(dim=1) - 2 * x @ book.T  # without x², which all share
            indices.append(distances.argmin(dim=-1))
            x = x - book[indices[-1]]
        return torch.stack(indices, dim=-1)
