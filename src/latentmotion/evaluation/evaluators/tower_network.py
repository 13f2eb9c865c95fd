"""Small towers for text and motion: a vector of unit length each, close if they mean the same.

Motions: two strided convolutions, four frames to a token, then a small transformer. Sentences: the
states of a text encoder's word pieces, then another. Mean and maximum over the tokens become the
vector. Rotations and contacts are not read: they follow from positions, and inverse kinematics of
foreign skeletons would add its own errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn import functional as F

from latentmotion.networks import transformer


@dataclass(frozen=True)
class TowerConfig:
    """Sizes of the towers."""

    features: int = 263
    """Features of a frame."""
    left_out: int = 4
    """Last features of a frame that are ignored: the foot contacts."""
    rotations: tuple[int, int] = (67, 193)
    """First and one past the last feature of the rotations, which are ignored."""
    word_width: int = 384
    """Numbers per word vector."""
    hidden: int = 128
    """Numbers per token inside."""
    motion_layers: int = 2
    """Transformer layers over tokens of four frames."""
    text_layers: int = 2
    """Transformer layers over words."""
    heads: int = 4
    """Attention heads."""
    width: int = 128
    """Numbers per motion and per sentence."""
    dropout: float = 0.1
    """Share of numbers dropped in training."""

    def build(self) -> TowerNetworks:
        """Returns the networks with random weights."""
        return TowerNetworks(self)


class TowerNetworks(nn.Module):
    """Both towers.

    Args:
        config: Their sizes.
    """

    def __init__(self, config: TowerConfig) -> None:
        super().__init__()
        self.config = config
        first, last = config.rotations
        seen = config.features - config.left_out - (last - first)
        self.halve = nn.Conv1d(seen, config.hidden, kernel_size=4, stride=2, padding=1)
        self.quarter = nn.Conv1d(config.hidden, config.hidden, kernel_size=4, stride=2, padding=1)
        self.motion_tower = Tower(config, config.motion_layers)
        self.words_in = nn.Linear(config.word_width, config.hidden)
        self.text_tower = Tower(config, config.text_layers)
        self.apply(transformer.initialize)

    def motions(
        self,
        features: Float[Tensor, "batch frames features"],
        mask: Bool[Tensor, "batch frames"],
    ) -> Float[Tensor, "batch width"]:
        """Returns the vectors of normalized motions; frames whose mask is False are zero."""
        first, last = self.config.rotations
        end = self.config.features - self.config.left_out
        seen = torch.cat([features[..., :first], features[..., last:end]], dim=-1)
        # What lies beyond the end is zero at every stage, as it is for the motion alone.
        half, tokens = mask[:, ::2], mask[:, ::4]
        x = F.gelu(self.halve(seen.transpose(1, 2))) * half[:, None]
        x = F.gelu(self.quarter(x)).transpose(1, 2)
        return self.motion_tower(x, tokens)

    def texts(
        self,
        words: Float[Tensor, "batch words word_width"],
        parts: Int[Tensor, "batch words"],
        mask: Bool[Tensor, "batch words"],
    ) -> Float[Tensor, "batch width"]:
        """Returns the vectors of sentences; parts of speech are not read."""
        return self.text_tower(self.words_in(words), mask)


class Tower(nn.Module):
    """Tokens to one vector of unit length.

    Args:
        config: Sizes.
        layers: Transformer layers.
    """

    def __init__(self, config: TowerConfig, layers: int) -> None:
        super().__init__()
        width, dropout = config.hidden, config.dropout
        self.position = transformer.SinePosition(width, dropout)
        self.layers = transformer.Stack(
            [
                transformer.EncoderLayer(
                    transformer.SelfAttention(width, config.heads, dropout),
                    transformer.FeedForward(width, 2 * width, dropout, nn.GELU()),
                    lambda: transformer.PreNorm(width, dropout),
                )
                for _ in range(layers)
            ],
            nn.LayerNorm(width),
        )
        self.out = nn.Linear(2 * width, config.width)

    def forward(
        self, x: Float[Tensor, "batch tokens hidden"], mask: Bool[Tensor, "batch tokens"]
    ) -> Float[Tensor, "batch width"]:
        """Returns the vectors of the tokens whose mask is True."""
        x = self.layers(self.position(x), mask)
        real = mask[..., None].to(x.dtype)
        mean = (x * real).sum(1) / real.sum(1)
        most = torch.where(mask[..., None], x, -1e4).amax(1)
        return F.normalize(self.out(torch.cat([mean, most], dim=-1)), dim=-1)
