"""Transformers with long skip connections (paper, section 3.1; after U-ViT, Bao et al. 2023).

    x → first layers, each output kept → middle layer → last layers → norm
    before each last layer:  x ← Linear([x, the most recent output kept])

Where the layer norm sits, which activation is used and whether there are skips are parts that
`networks.build` picks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import Tensor, nn

from latentmotion.errors import InputError
from latentmotion.networks.attention import CrossAttention, Dropout, SelfAttention

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
    """Self-attention, then feed-forward.

    Args:
        attention: Called with (x, mask).
        feed_forward: Called with x.
        residual: Builds what goes around one part.
    """

    def __init__(
        self, attention: nn.Module, feed_forward: nn.Module, residual: Callable[[], nn.Module]
    ) -> None:
        super().__init__()
        self.attention = attention
        self.feed_forward = feed_forward
        self.around_attention = residual()
        self.around_feed_forward = residual()

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        """Returns x plus the attention of its tokens to each other."""
        x = self.around_attention(x, lambda y: self.attention(y, mask))
        return self.around_feed_forward(x, self.feed_forward)


class DecoderLayer(nn.Module):
    """Self-attention, then a look at the memory, then feed-forward.

    Args:
        attention: Called with (x, mask).
        cross_attention: Called with (x, memory, memory_mask).
        feed_forward: Called with x.
        residual: Builds what goes around one part.
    """

    def __init__(
        self,
        attention: nn.Module,
        cross_attention: nn.Module,
        feed_forward: nn.Module,
        residual: Callable[[], nn.Module],
    ) -> None:
        super().__init__()
        self.attention = attention
        self.cross_attention = cross_attention
        self.feed_forward = feed_forward
        self.around_attention = residual()
        self.around_cross_attention = residual()
        self.around_feed_forward = residual()

    def forward(self, x: Tensor, mask: Tensor, memory: Tensor, memory_mask: Tensor) -> Tensor:
        """Returns x plus the attention of its tokens to each other and to the memory."""
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


def initialize(module: nn.Module) -> None:
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
