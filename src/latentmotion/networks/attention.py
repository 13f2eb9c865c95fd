"""Attention: softmax(q kᵀ / sqrt(width / heads)) v, over tokens whose mask is True; and dropout."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn


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
        return x * _kept(x, self.share).to(x.dtype).div_(1 - self.share)


def _kept(x: Tensor, share: float) -> Tensor:
    words = torch.empty((x.numel() + 3) // 4, dtype=torch.int64).random_(-(2**63), None)
    bits = words.view(torch.int16)[: x.numel()].view(x.shape)
    return bits >= round(share * 2**16) - 2**15


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
            return self._attend_to_one(x, memory).expand_as(x)
        (q,) = _split_heads(self.query(x), self.heads, 1)
        k, v = _split_heads(self.key_value(memory), self.heads, 2)
        return self.output(_attend(q, k, v, mask, self.dropout if self.training else 0.0))

    def _attend_to_one(self, x: Tensor, memory: Tensor) -> Tensor:
        """The softmax over one key is 1, whatever the query: the paper's own case, MLD-1."""
        value = self.key_value(memory).chunk(2, dim=-1)[1]
        # The queries keep the gradient that the full formula gives them: zero.
        return self.output(value + 0 * self.query(x[:, :1]))


def _split_heads(x: Tensor, heads: int, parts: int) -> tuple[Tensor, ...]:
    """(batch, tokens, parts · width) → parts of (batch, heads, tokens, width / heads)."""
    return x.unflatten(-1, (parts, heads, -1)).permute(2, 0, 3, 1, 4).unbind(0)


def _attend(q: Tensor, k: Tensor, v: Tensor, mask: Tensor, dropout: float) -> Tensor:
    # Here True means "attend to it", PyTorch's own convention in this one function.
    heads = F.scaled_dot_product_attention(
        q, k, v, attn_mask=mask[:, None, None, :], dropout_p=dropout
    )
    return heads.transpose(1, 2).flatten(2)
