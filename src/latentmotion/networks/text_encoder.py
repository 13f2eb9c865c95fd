"""The student's network: word pieces → pooled sentence embedding and one state per piece.

It is a post-norm transformer encoder like BERT's (Devlin et al. 2019), so that it can start from
chosen layers of its teacher; the pooled embedding is the mean of the states, scaled to unit length,
as in Sentence-BERT (Reimers and Gurevych 2019). For export its weights can be kept in 8 bits.

Each row w of a matrix is kept as integers q and one scale s, w ≈ s · q. Only storage shrinks, by
four; arithmetic stays in float32. The rounding error of a weight is at most half of
s = max |w| / 127.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn import functional as F


class Packed(nn.Module):
    """A layer with its matrix in 8 bits."""

    packed: Tensor
    scale: Tensor

    def __init__(self, layer: nn.Linear | nn.Embedding) -> None:
        super().__init__()
        packed, scale = pack(layer.weight.detach())
        self.register_buffer("packed", packed)
        self.register_buffer("scale", scale)


class PackedLinear(Packed):
    """`nn.Linear` with its matrix in 8 bits."""

    bias: Tensor

    def __init__(self, linear: nn.Linear) -> None:
        super().__init__(linear)
        self.register_buffer("bias", linear.bias.detach().clone())

    def forward(self, inputs: Float[Tensor, "*batch width"]) -> Tensor:
        """Returns the linear map of `inputs`."""
        return F.linear(inputs, self.packed.to(inputs.dtype) * self.scale, self.bias)


class PackedEmbedding(Packed):
    """`nn.Embedding` with its table in 8 bits."""

    def forward(self, tokens: Int[Tensor, "*batch"]) -> Tensor:
        """Returns one row of the table per token."""
        return self.packed[tokens].to(self.scale.dtype) * self.scale[tokens]


def pack(
    weight: Float[Tensor, "rows ..."],
) -> tuple[Int[Tensor, "rows ..."], Float[Tensor, "rows ..."]]:
    """Returns (integers, scales) of a matrix or a kernel; a row of zeros stays zeros."""
    # A scale per row: rows of embeddings differ by orders of magnitude; zero rows keep a positive
    # one.
    widths = tuple(range(1, weight.ndim))
    scale = (weight.abs().amax(dim=widths, keepdim=True) / 127).clamp_min(1e-12)
    return (weight / scale).round().to(torch.int8), scale


def packed(network: nn.Module) -> nn.Module:
    """Returns a copy of a network with every linear map and table in 8 bits."""
    small = copy.deepcopy(network).eval()
    for module in list(small.modules()):
        for name, child in module.named_children():
            if isinstance(child, nn.Linear):
                setattr(module, name, PackedLinear(child))
            elif isinstance(child, nn.Embedding):
                setattr(module, name, PackedEmbedding(child))
    return small


@dataclass(frozen=True)
class NetworkShape:
    """Sizes of a student."""

    vocabulary: int  # Number of word pieces.

    width: int = 384  # Width of states and of the pooled embedding.

    layers: int = 3  # Transformer layers.

    heads: int = 12  # Attention heads.

    hidden: int = 1536  # Width between the two linear maps of each layer.

    positions: int = 128  # Longest sentence, in pieces.


class Layer(nn.Module):
    """Self-attention and a two-layer perceptron, each followed by residual and norm."""

    def __init__(self, width: int, heads: int, hidden: int) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)
        self.attention_norm = nn.LayerNorm(width, eps=1e-12)
        self.up = nn.Linear(width, hidden)
        self.down = nn.Linear(hidden, width)
        self.output_norm = nn.LayerNorm(width, eps=1e-12)

    def forward(
        self, states: Float[Tensor, "batch words width"], mask: Bool[Tensor, "batch words"]
    ) -> Float[Tensor, "batch words width"]:
        """Returns the states after one layer; masked pieces are never attended to."""
        batch, words, width = states.shape
        qkv = self.qkv(states).reshape(batch, words, 3, self.heads, width // self.heads)
        q, k, v = qkv.permute(2, 0, 3, 1, 4).unbind(0)
        attended = F.scaled_dot_product_attention(q, k, v, attn_mask=mask[:, None, None, :])
        attended = self.out(attended.transpose(1, 2).reshape(batch, words, width))
        states = self.attention_norm(states + attended)
        return self.output_norm(states + self.down(F.gelu(self.up(states))))


class StudentNetwork(nn.Module):
    """Piece embeddings, learned positions, a few layers, mean pooling."""

    def __init__(self, shape: NetworkShape) -> None:
        super().__init__()
        self.shape = shape
        self.pieces = nn.Embedding(shape.vocabulary, shape.width)
        self.positions = nn.Embedding(shape.positions, shape.width)
        self.norm = nn.LayerNorm(shape.width, eps=1e-12)
        self.layers = nn.ModuleList(
            Layer(shape.width, shape.heads, shape.hidden) for _ in range(shape.layers)
        )

    def forward(
        self, tokens: Int[Tensor, "batch words"], mask: Bool[Tensor, "batch words"]
    ) -> tuple[Float[Tensor, "batch width"], Float[Tensor, "batch words width"]]:
        """Returns the pooled embedding of unit length and the state of every piece."""
        numbers = torch.arange(tokens.shape[1], device=tokens.device)
        states = self.norm(self.pieces(tokens) + self.positions(numbers))
        for layer in self.layers:
            states = layer(states, mask)
        weights = mask[..., None].to(states.dtype)
        pooled = (states * weights).sum(1) / weights.sum(1)
        return F.normalize(pooled.float(), dim=-1), states


# BERT's names of a layer's parts, by ours.
_BERT_NAMES = {
    "out": "attention.output.dense",
    "attention_norm": "attention.output.LayerNorm",
    "up": "intermediate.dense",
    "down": "output.dense",
    "output_norm": "output.LayerNorm",
}


def teacher_state(
    teacher: Mapping[str, Tensor], pieces: Sequence[int], layers: Sequence[int], positions: int
) -> dict[str, Tensor]:
    """Returns a student's first weights: chosen layers and pieces of a BERT teacher.

    Args:
        teacher: State of Hugging Face's `BertModel`.
        pieces: The teacher's id of each piece of the student.
        layers: The teacher's layer that each layer of the student starts from.
        positions: Number of positions kept.
    """
    token_type = teacher["embeddings.token_type_embeddings.weight"][0]
    state = {
        "pieces.weight": teacher["embeddings.word_embeddings.weight"][list(pieces)],
        # Every piece is of the first type, so its embedding is folded into the positions.
        "positions.weight": teacher["embeddings.position_embeddings.weight"][:positions]
        + token_type,
        "norm.weight": teacher["embeddings.LayerNorm.weight"],
        "norm.bias": teacher["embeddings.LayerNorm.bias"],
    }
    for number, layer in enumerate(layers):
        for kind in ("weight", "bias"):
            source, target = f"encoder.layer.{layer}", f"layers.{number}"
            attention = (f"{source}.attention.self.{part}" for part in ("query", "key", "value"))
            parts = [teacher[f"{name}.{kind}"] for name in attention]
            state[f"{target}.qkv.{kind}"] = torch.cat(parts)
            for ours, theirs in _BERT_NAMES.items():
                state[f"{target}.{ours}.{kind}"] = teacher[f"{source}.{theirs}.{kind}"]
    return {name: tensor.clone() for name, tensor in state.items()}
