"""Transformers with long skip connections (paper, section 3.1); attention and embeddings.

    x → first layers, each output kept → middle layer → last layers → norm
    before each last layer:  x ← Linear([x, the most recent output kept])

A `TransformerConfig` picks where the layer norm sits, which activation is used and whether there
are skips.

A position embedding is learned, as in the paper, or a sine: p[i, 2k] = sin(i · 10000^(-2k/width)),
p[i, 2k+1] = cos(same) (Vaswani et al. 2017, section 3.5). Timesteps use sines alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from latentmotion.errors import InputError
from latentmotion.model.config import PositionKind, TransformerConfig


class Dropout(nn.Module):
    """Sets a share of the numbers to zero in training, and scales the others up."""

    def __init__(self, share: float) -> None:
        super().__init__()
        self.share = share

    def forward(self, x: Tensor) -> Tensor:
        """Returns x in evaluation, and a thinned x in training."""
        if not self.training or self.share == 0:
            return x
        if x.device.type != "cpu":
            return F.dropout(x, self.share)
        # Four 16-bit numbers from each 64-bit draw, since the generator is the slow part.
        words = torch.empty((x.numel() + 3) // 4, dtype=torch.int64).random_(-(2**63), None)
        bits = words.view(torch.int16)[: x.numel()].view(x.shape)
        # Bits are signed, uniform on -2¹⁵ … 2¹⁵ - 1.
        mask = bits >= round(self.share * 2**16) - 2**15
        return x * mask.to(x.dtype).div_(1 - self.share)


class SelfAttention(nn.Module):
    """Every token looks at every real token."""

    def __init__(self, width: int, heads: int, dropout: float) -> None:
        super().__init__()
        self.heads = heads
        self.dropout = dropout
        self.query_key_value = nn.Linear(width, 3 * width)
        self.output = nn.Linear(width, width)

    def forward(
        self, x: Float[Tensor, "batch tokens width"], mask: Bool[Tensor, "batch tokens"]
    ) -> Float[Tensor, "batch tokens width"]:
        """Attends to the tokens whose mask is True."""
        q, k, v = _split_heads(self.query_key_value(x), self.heads, 3)
        return self.output(_attend(q, k, v, mask, self.dropout if self.training else 0.0))


class CrossAttention(nn.Module):
    """Every token looks at every real token of a memory."""

    def __init__(self, width: int, heads: int, dropout: float) -> None:
        super().__init__()
        self.heads = heads
        self.dropout = dropout
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.output = nn.Linear(width, width)

    def forward(
        self,
        x: Float[Tensor, "batch tokens width"],
        memory: Float[Tensor, "batch words width"],
        mask: Bool[Tensor, "batch words"],
    ) -> Float[Tensor, "batch tokens width"]:
        """Attends to the memory's tokens whose mask is True."""
        if memory.shape[1] == 1:
            # The softmax over one key is 1, whatever the query: the paper's own case, MLD-1.
            value = self.key_value(memory).chunk(2, dim=-1)[1]
            # The queries keep the gradient that the full formula gives them: zero.
            return self.output(value + 0 * self.query(x[:, :1])).expand_as(x)
        (q,) = _split_heads(self.query(x), self.heads, 1)
        k, v = _split_heads(self.key_value(memory), self.heads, 2)
        return self.output(_attend(q, k, v, mask, self.dropout if self.training else 0.0))


def _split_heads(x: Tensor, heads: int, parts: int) -> tuple[Tensor, ...]:
    """(batch, tokens, parts · width) → parts of (batch, heads, tokens, width / heads)."""
    return x.unflatten(-1, (parts, heads, -1)).permute(2, 0, 3, 1, 4).unbind(0)


def _attend(q: Tensor, k: Tensor, v: Tensor, mask: Tensor, dropout: float) -> Tensor:
    # Here True means "attend to it", PyTorch's own convention in this one function.
    attend = partial(
        F.scaled_dot_product_attention, attn_mask=mask[:, None, None, :], dropout_p=dropout
    )
    if q.requires_grad and q.dtype == torch.bfloat16 and q.device.type == "cpu":
        # On a CPU, PyTorch's gradient in bfloat16 takes five times as long as in float32.
        with torch.autocast("cpu", enabled=False):
            heads = attend(q.float(), k.float(), v.float()).to(q.dtype)
    else:
        heads = attend(q, k, v)
    return heads.transpose(1, 2).flatten(2)


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


def _residual(config: TransformerConfig) -> PostNorm:
    """Returns what goes around one part of a layer."""
    return {"post": PostNorm, "pre": PreNorm}[config.norm](config.width, config.dropout)


class FeedForward(nn.Sequential):
    """Linear, activation, linear, on each token alone."""

    def __init__(self, config: TransformerConfig) -> None:
        activation = {"gelu": nn.GELU, "relu": nn.ReLU}[config.activation]()
        layers = [nn.Linear(config.width, config.hidden), activation, Dropout(config.dropout)]
        super().__init__(*layers, nn.Linear(config.hidden, config.width))


class EncoderLayer(nn.Module):
    """Self-attention, then feed-forward."""

    def __init__(self, config: TransformerConfig) -> None:
        super().__init__()
        self.attention = SelfAttention(config.width, config.heads, config.attention_dropout)
        self.feed_forward = FeedForward(config)
        self.around_attention = _residual(config)
        self.around_feed_forward = _residual(config)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        """Returns x plus the attention of its tokens to each other."""
        x = self.around_attention(x, lambda y: self.attention(y, mask))
        return self.around_feed_forward(x, self.feed_forward)


class DecoderLayer(nn.Module):
    """Self-attention, then a look at the memory, then feed-forward."""

    def __init__(self, config: TransformerConfig) -> None:
        super().__init__()
        sizes = config.width, config.heads, config.attention_dropout
        self.attention, self.cross_attention = SelfAttention(*sizes), CrossAttention(*sizes)
        self.feed_forward = FeedForward(config)
        self.around_attention = _residual(config)
        self.around_cross_attention = _residual(config)
        self.around_feed_forward = _residual(config)

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
        skips = []
        for layer in self.first:
            x = layer(x, *context)
            skips.append(x)
        x = self.middle(x, *context)
        for join, layer in zip(self.joins, self.last, strict=True):
            x = layer(join(torch.cat([x, skips.pop()], dim=-1)), *context)
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


LEARNED_LENGTH = 500  # Longest sequence of a learned table, the authors' limit.


class LearnedPosition(nn.Module):
    """A table learned in training."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.table = nn.Parameter(torch.rand(LEARNED_LENGTH, width))

    def forward(
        self, x: Float[Tensor, "batch tokens width"], start: int | torch.SymInt = 0
    ) -> Float[Tensor, "batch tokens width"]:
        """Adds the positions start, start + 1, ..."""
        return x + self.table[start : start + x.shape[1]]


class SinePosition(nn.Module):
    """Fixed sines, with dropout on the sum as in ACTOR (Petrovich et al. 2021).

    They are computed for the positions that are asked for, so that no table limits the length or
    fills an exported graph.
    """

    rate: Tensor

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.register_buffer("rate", sine_rate(width), persistent=False)
        self.dropout = Dropout(dropout)

    def forward(
        self, x: Float[Tensor, "batch tokens width"], start: int | torch.SymInt = 0
    ) -> Float[Tensor, "batch tokens width"]:
        """Adds the positions start, start + 1, ..."""
        positions: Tensor = torch.arange(x.shape[1], device=x.device) + start  # type: ignore
        return self.dropout(x + sines(positions, self.rate))


def sines(
    positions: Int[Tensor, " tokens"], rate: Float[Tensor, " half"]
) -> Float[Tensor, "tokens width"]:
    """Returns what the positions add."""
    angles = positions[:, None] * rate
    return torch.stack([torch.sin(angles), torch.cos(angles)], dim=-1).flatten(1)


def sine_rate(width: int) -> Float[Tensor, " half"]:
    """Returns 10000^(-2k/width)."""
    return torch.exp(torch.arange(0, width, 2) * (-math.log(10_000.0) / width))


class NumberEmbedding(nn.Module):
    """One token per number.

    Args:
        sine_width: Width of the sinusoid, even.
        width: Width of the token.
        scale: Multiplies the number first: a time in 0 .. 1 wants 1000, so that it varies as much
            as the discrete times 0 .. 999.
    """

    def __init__(self, sine_width: int, width: int, scale: float = 1.0) -> None:
        super().__init__()
        self.sine_width = sine_width
        self.scale = scale
        self.network = nn.Sequential(
            nn.Linear(sine_width, width), nn.SiLU(), nn.Linear(width, width)
        )

    def forward(self, number: Float[Tensor, " batch"]) -> Float[Tensor, "batch width"]:
        """Returns the tokens."""
        return self.network(sinusoid(number * self.scale, self.sine_width))


def sinusoid(number: Float[Tensor, " batch"], width: int) -> Float[Tensor, "batch width"]:
    """Returns the cosines, then the sines, of the number at falling frequencies."""
    half = width // 2
    steps = torch.arange(half, dtype=torch.float32, device=number.device)
    angles = number[:, None] * torch.exp(-math.log(10_000.0) / half * steps)
    return torch.cat([torch.cos(angles), torch.sin(angles)], dim=-1)


def position(kind: PositionKind, width: int, dropout: float) -> nn.Module:
    """Builds the positions of one sequence."""
    return LearnedPosition(width) if kind == "learned" else SinePosition(width, dropout)


def layer_stack(config: TransformerConfig, layer: type[EncoderLayer | DecoderLayer]) -> nn.Module:
    """Builds a stack of a kind of layers, called with the tokens and what each layer takes."""
    layers = [layer(config) for _ in range(config.layers)]
    norm = nn.LayerNorm(config.width) if config.final_norm else nn.Identity()
    layered = SkipStack(layers, norm, config.width) if config.skips else Stack(layers, norm)
    return layered.apply(initialize)
