"""Transformers with long skip connections (paper, section 3.1; after U-ViT, Bao et al. 2023).

    x → first layers, each output kept → middle layer → last layers → norm
    before each last layer:  x ← Linear([x, the most recent output kept])

Where the layer norm sits, which activation is used and whether there are skips are parts that
`TransformerConfig` picks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn

from latentmotion.errors import InputError
from latentmotion.nn.attention import CrossAttention, SelfAttention
from latentmotion.nn.dropout import Dropout

Branch = Callable[[Tensor], Tensor]


class PostNorm(nn.Module):
    """norm(x + branch(x)), as in the paper."""

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.dropout = Dropout(dropout)

    def forward(self, x: Tensor, branch: Branch) -> Tensor:
        """Adds the branch's output, then normalizes."""
        return self.norm(x + self.dropout(branch(x)))


class PreNorm(PostNorm):
    """x + branch(norm(x))."""

    def forward(self, x: Tensor, branch: Branch) -> Tensor:
        """Normalizes, then adds the branch's output."""
        return x + self.dropout(branch(self.norm(x)))


class FeedForward(nn.Sequential):
    """Linear, activation, linear, on each token alone."""

    def __init__(self, width: int, hidden: int, dropout: float, activation: nn.Module) -> None:
        layers = [nn.Linear(width, hidden), activation, Dropout(dropout)]
        super().__init__(*layers, nn.Linear(hidden, width))


class EncoderLayer(nn.Module):
    """Self-attention, then feed-forward."""

    def __init__(self, config: TransformerConfig) -> None:
        super().__init__()
        self.attention = SelfAttention(config.width, config.heads, config.attention_dropout)
        self.feed_forward = config.feed_forward()
        self.around_attention = config.residual()
        self.around_feed_forward = config.residual()

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        """Returns x with what the tokens told each other."""
        x = self.around_attention(x, lambda y: self.attention(y, mask))
        return self.around_feed_forward(x, self.feed_forward)


class DecoderLayer(nn.Module):
    """Self-attention, then a look at the memory, then feed-forward."""

    def __init__(self, config: TransformerConfig) -> None:
        super().__init__()
        self.attention = SelfAttention(config.width, config.heads, config.attention_dropout)
        self.cross_attention = CrossAttention(config.width, config.heads, config.attention_dropout)
        self.feed_forward = config.feed_forward()
        self.around_attention = config.residual()
        self.around_cross_attention = config.residual()
        self.around_feed_forward = config.residual()

    def forward(self, x: Tensor, mask: Tensor, memory: Tensor, memory_mask: Tensor) -> Tensor:
        """Returns x with what the tokens and the memory told them."""
        x = self.around_attention(x, lambda y: self.attention(y, mask))
        x = self.around_cross_attention(x, lambda y: self.cross_attention(y, memory, memory_mask))
        return self.around_feed_forward(x, self.feed_forward)


class Stack(nn.Module):
    """Layers one after the other."""

    def __init__(self, layers: Iterable[nn.Module], norm: nn.Module) -> None:
        super().__init__()
        self.layers = nn.ModuleList(layers)
        self.norm = norm

    def forward(self, x: Tensor, *context: Tensor) -> Tensor:
        """Applies every layer to x; the context (masks, memory) is the same for all."""
        for layer in self.layers:
            x = layer(x, *context)
        return self.norm(x)


class SkipStack(nn.Module):
    """An odd number of layers, the first half joined to the last half as in a U-Net."""

    def __init__(self, layers: Iterable[nn.Module], norm: nn.Module, width: int) -> None:
        super().__init__()
        every = list(layers)
        if len(every) % 2 == 0:
            raise InputError(f"{len(every)} layers: long skips need an odd number of them")
        half = len(every) // 2
        self.first = nn.ModuleList(every[:half])
        self.middle = every[half]
        self.last = nn.ModuleList(every[half + 1 :])
        self.joins = nn.ModuleList(nn.Linear(2 * width, width) for _ in range(half))
        self.norm = norm

    def forward(self, x: Tensor, *context: Tensor) -> Tensor:
        """Applies every layer to x; the context (masks, memory) is the same for all."""
        kept = []
        for layer in self.first:
            x = layer(x, *context)
            kept.append(x)
        x = self.middle(x, *context)
        for join, layer in zip(self.joins, self.last, strict=True):
            x = layer(join(torch.cat([x, kept.pop()], dim=-1)), *context)
        return self.norm(x)


@dataclass(frozen=True)
class TransformerConfig:
    """Size and shape of a stack; the defaults are the paper's."""

    width: int = 256
    """Numbers per token."""
    layers: int = 9
    """Number of layers, odd where there are skips."""
    heads: int = 4
    """Attention heads."""
    hidden: int = 1024
    """Width inside the feed-forward part."""
    dropout: float = 0.1
    """Share of numbers dropped in training."""
    attention_dropout: float = 0.0
    """Share of attention dropped in training; the authors drop 0.1, at a third of the speed."""
    activation: Literal["gelu", "relu"] = "gelu"
    """Activation of the feed-forward part."""
    norm: Literal["post", "pre"] = "post"
    """Whether a layer normalizes after or before each of its parts."""
    skips: bool = True
    """Whether first and last layers are joined."""
    final_norm: bool = True
    """Whether a last normalization closes the stack."""

    def encoder(self) -> nn.Module:
        """Builds a stack called with (x, mask)."""
        return self._stack(EncoderLayer)

    def decoder(self) -> nn.Module:
        """Builds a stack called with (x, mask, memory, memory_mask)."""
        return self._stack(DecoderLayer)

    def feed_forward(self) -> nn.Module:
        """Builds the feed-forward part of one layer."""
        activation = {"gelu": nn.GELU, "relu": nn.ReLU}[self.activation]()
        return FeedForward(self.width, self.hidden, self.dropout, activation)

    def residual(self) -> nn.Module:
        """Builds what goes around one part of a layer."""
        return {"post": PostNorm, "pre": PreNorm}[self.norm](self.width, self.dropout)

    def _stack(self, layer: Callable[[TransformerConfig], nn.Module]) -> nn.Module:
        layers = [layer(self) for _ in range(self.layers)]
        norm = nn.LayerNorm(self.width) if self.final_norm else nn.Identity()
        stack = SkipStack(layers, norm, self.width) if self.skips else Stack(layers, norm)
        stack.apply(_initialize)
        return stack


def _initialize(module: nn.Module) -> None:
    """Xavier-uniform weights; queries, keys and values count as one matrix, as in PyTorch's own."""
    if isinstance(module, nn.Linear):
        nn.init.xavier_uniform_(module.weight)
    if isinstance(module, SelfAttention):
        _initialize_projections(module.output, module.query_key_value)
    if isinstance(module, CrossAttention):
        _initialize_projections(module.output, module.query, module.key_value)


def _initialize_projections(output: nn.Linear, *inputs: nn.Linear) -> None:
    bound = (6 / (4 * output.in_features)) ** 0.5
    nn.init.zeros_(output.bias)
    for linear in inputs:
        nn.init.uniform_(linear.weight, -bound, bound)
        nn.init.zeros_(linear.bias)
