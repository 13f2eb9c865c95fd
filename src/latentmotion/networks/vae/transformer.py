"""The paper's motion VAE (section 3.1), and its decoders from latents to frames.

Each frame of a decoder is a query that knows only its position. There are the paper's decoder, the
authors' other one, and one that does most of its work at a quarter of the frame rate.

VAEs of the paper's baselines: VPoser over time (table 4), and none at all.

    encode:  frames × features → norm → 512, leaky ReLU → norm → 512 → 512 → mean and deviation
    decode:  256 → 512 → 512 → frames × features

It has one fixed length. A shorter motion repeats its last frame, so what its padding holds
changes nothing; a longer one is refused. In training the motions of a batch normalize each other
(BatchNorm), so a batch of two is two batches of one only in `eval()`.

So diffusion on raw frames, the paper's "MLD without VAE" and MDM, is stage 2 like any other.
"""

from __future__ import annotations

from dataclasses import replace

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from latentmotion.model.config import TransformerVAEConfig, VPoserTConfig
from latentmotion.networks.transformer import DecoderLayer, EncoderLayer, layer_stack, position
from latentmotion.networks.vae.interface import (
    Features,
    FrameMask,
    Latents,
    MotionVAE,
    Posterior,
    TokenMask,
)

STRIDE = 4  # Frames that a coarse query of `TwoRateDecoder` stands for.


class FrameDecoder(nn.Module):
    """Latents to one output per frame, whose query knows only its position."""

    def __init__(self, config: TransformerVAEConfig) -> None:
        super().__init__()
        whole = config.transformer
        self.position = position(config.position, whole.width, whole.dropout)


class CrossDecoder(FrameDecoder):
    """Positions as queries, which look at the latents by cross-attention."""

    def __init__(self, config: TransformerVAEConfig) -> None:
        super().__init__(config)
        self.decoder = layer_stack(config.transformer, DecoderLayer)

    def forward(self, latents: Tensor, mask: Tensor) -> Tensor:
        """Returns (batch, frames, width)."""
        queries = self.position(_blank_frames(latents, mask))
        return self.decoder(queries, mask, latents, all_real(latents))


class JointDecoder(FrameDecoder):
    """Latents and positions in one sequence through an encoder (the authors' all_encoder)."""

    def __init__(self, config: TransformerVAEConfig) -> None:
        super().__init__(config)
        self.encoder = layer_stack(config.transformer, EncoderLayer)

    def forward(self, latents: Tensor, mask: Tensor) -> Tensor:
        """Returns (batch, frames, width)."""
        x = self.position(torch.cat([latents, _blank_frames(latents, mask)], dim=1))
        x = self.encoder(x, torch.cat([all_real(latents), mask], dim=1))
        return x[:, latents.shape[1] :]


class TwoRateDecoder(FrameDecoder):
    """Coarse layers for every fourth frame; what they find unfolds into frames for the fine layers.

    Only the coarse queries have positions.
    """

    def __init__(self, config: TransformerVAEConfig) -> None:
        super().__init__(config)
        whole, fine = config.transformer, config.fine_layers
        self.coarse = layer_stack(replace(whole, layers=whole.layers - fine), DecoderLayer)
        self.unfold = nn.Linear(whole.width, STRIDE * whole.width)
        self.fine = layer_stack(replace(whole, layers=fine, skips=False), DecoderLayer)

    def forward(self, latents: Tensor, mask: Tensor) -> Tensor:
        """Returns (batch, frames, width)."""
        real, frames = all_real(latents), mask.shape[1]
        steps = F.pad(mask, (0, -frames % STRIDE))[:, ::STRIDE]  #       (batch, frames / 4)
        x = self.coarse(self.position(_blank_frames(latents, steps)), steps, latents, real)
        x = self.unfold(x).unflatten(-1, (STRIDE, -1)).flatten(1, 2)  # (batch, frames, width)
        return self.fine(x[:, :frames], mask, latents, real)


def all_real(tokens: Tensor) -> Tensor:
    """Returns a mask of tokens none of which is padding."""
    return torch.ones_like(tokens[..., 0], dtype=torch.bool)


def _blank_frames(latents: Tensor, mask: Tensor) -> Tensor:
    return latents.new_zeros(*mask.shape, latents.shape[-1])


# Decoders by the name that configurations have for them, called with (latents, mask).
DECODERS = {"cross": CrossDecoder, "joint": JointDecoder, "two_rate": TwoRateDecoder}


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


class TransformerVAE(MotionVAE):
    """A VAE with a fixed number of latent tokens for the whole motion.

    The order in which parts are built is that in which a seed's numbers are drawn for them.

    Args:
        config: Which parts it has, and their sizes.
    """

    DECODER_MODULES = ("widen", "decoder", "frames_out")

    def __init__(self, config: TransformerVAEConfig) -> None:
        super().__init__()
        width, latent = config.transformer.width, config.latent_width or config.transformer.width
        adapted, own_tokens = config.latent_width is not None, config.distribution == "tokens"
        self.tokens, self.latent_width = config.tokens, latent
        # Features of a frame to the width of the transformer, and back.
        self.frames_in = nn.Linear(config.features, width)
        self.frames_out = nn.Linear(width, config.features)
        # Learned tokens whose outputs tell the posterior.
        count = config.tokens * (2 if own_tokens else 1)
        self.summary = nn.Parameter(torch.randn(count, width))
        self.position = position(config.position, width, config.transformer.dropout)
        self.encoder = layer_stack(config.transformer, EncoderLayer)  # called with (x, mask)
        # Outputs of the summary tokens to a `Posterior`.
        self.distribution = TokenDistribution() if own_tokens else LinearDistribution(latent)
        self.decoder = DECODERS[config.decoding](config)  # latents and mask to outputs per frame
        # The width of the transformer to that of the latents, and back.
        self.narrow = nn.Linear(width, latent) if adapted else nn.Identity()
        self.widen = nn.Linear(latent, width) if adapted else nn.Identity()

    def encode(self, features: Features, mask: FrameMask) -> Posterior:
        """Returns the distribution of the latent tokens."""
        summary = self.summary.expand(features.shape[0], -1, -1)
        x = self.position(torch.cat([summary, self.frames_in(features)], dim=1))
        x = self.encoder(x, torch.cat([all_real(summary), mask], dim=1))
        return self.distribution(self.narrow(x[:, : summary.shape[1]]))

    def decode(self, latents: Latents, mask: FrameMask) -> Features:
        """Returns features of as many frames as the mask has."""
        return self.frames_out(self.decoder(self.widen(latents), mask)) * mask[..., None]

    def latent_mask(self, mask: FrameMask) -> TokenMask:
        """Returns True for every token: each stands for the whole motion."""
        return mask.new_ones(mask.shape[0], self.tokens)


LEAST_DEVIATION = 1e-8  # Keeps the logarithm of a vanishing deviation finite.


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

    def encode(self, features: Features, mask: FrameMask) -> Posterior:
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

    def decode(self, latents: Latents, mask: FrameMask) -> Features:
        """Returns the first frames of the one length.

        Raises:
            InputError: The mask is longer than the one length.
        """
        self.config.check(mask.shape[1])
        return self.decoder(latents[:, 0])[:, : mask.shape[1]] * mask[..., None]

    def latent_mask(self, mask: FrameMask) -> TokenMask:
        """Returns True for the one token."""
        return mask.new_ones(mask.shape[0], 1)


class IdentityVAE(MotionVAE):
    """One latent token per frame, which is the frame, with a deviation of 0."""

    DECODER_MODULES = ()

    def __init__(self, features: int) -> None:
        super().__init__()
        self.latent_width = features

    def encode(self, features: Features, mask: FrameMask) -> Posterior:
        """Returns the real frames as means, with the logarithm of a variance of 0."""
        return Posterior(features * mask[..., None], torch.full_like(features, -torch.inf))

    def decode(self, latents: Latents, mask: FrameMask) -> Features:
        """Returns the latents, zero on padding."""
        return latents * mask[..., None]

    def latent_mask(self, mask: FrameMask) -> TokenMask:
        """Returns the mask itself."""
        return mask
