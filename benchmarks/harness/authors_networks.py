"""Networks of the shapes in the authors' code, written from the paper and measurements.

What costs time here and not in ours is `nn.MultiheadAttention` with its default
`need_weights=True`: attention maps are materialized, fused kernels are off. Sequence first, as
there. Weights are random: a reference for time alone.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

WIDTH, LAYERS, HEADS, HIDDEN, DROPOUT = 256, 9, 4, 1024, 0.1
TEXT_WIDTH, TEXT_LAYERS, TEXT_TOKENS, WORDS = 768, 12, 77, 49408


class Layer(nn.Module):
    """Self-attention, optionally a look at a memory, feed-forward; normalized after each."""

    def __init__(self, memory: bool) -> None:
        super().__init__()
        self.itself = nn.MultiheadAttention(WIDTH, HEADS, DROPOUT)
        self.memory = nn.MultiheadAttention(WIDTH, HEADS, DROPOUT) if memory else None
        self.first, self.second = nn.Linear(WIDTH, HIDDEN), nn.Linear(HIDDEN, WIDTH)
        self.norms = nn.ModuleList(nn.LayerNorm(WIDTH) for _ in range(3 if memory else 2))
        self.dropout = nn.Dropout(DROPOUT)

    def forward(self, x: Tensor, padding: Tensor | None, memory: Tensor | None) -> Tensor:
        """Returns (length, batch, width)."""
        x = self.norms[0](x + self.dropout(self.itself(x, x, x, key_padding_mask=padding)[0]))
        if self.memory is not None:
            x = self.norms[1](x + self.dropout(self.memory(x, memory, memory)[0]))
        hidden = self.dropout(F.gelu(self.first(x)))
        return self.norms[-1](x + self.dropout(self.second(hidden)))


class Skips(nn.Module):
    """Layers, the first half joined to the last half."""

    def __init__(self, memory: bool = False) -> None:
        super().__init__()
        self.layers = nn.ModuleList(Layer(memory) for _ in range(LAYERS))
        self.joins = nn.ModuleList(nn.Linear(2 * WIDTH, WIDTH) for _ in range(LAYERS // 2))
        self.norm = nn.LayerNorm(WIDTH)

    def forward(
        self, x: Tensor, padding: Tensor | None = None, memory: Tensor | None = None
    ) -> Tensor:
        """Returns (length, batch, width)."""
        kept = []
        for number, layer in enumerate(self.layers):
            if number > LAYERS // 2:
                join = self.joins[number - LAYERS // 2 - 1]
                x = join(torch.cat([x, kept.pop()], dim=-1))
            x = layer(x, padding, memory)
            if number < LAYERS // 2:
                kept.append(x)
        return self.norm(x)


class VAE(nn.Module):
    """MLD-1's: two summary tokens before the frames, of which one is the mean."""

    def __init__(self, features: int, frames: int) -> None:
        super().__init__()
        self.into, self.out = nn.Linear(features, WIDTH), nn.Linear(WIDTH, features)
        self.summary = nn.Parameter(torch.randn(2, 1, WIDTH))
        self.places = nn.Parameter(torch.rand(2, frames + 2, 1, WIDTH))
        self.encoder, self.decoder = Skips(), Skips(memory=True)

    def encode(self, features: Tensor, padding: Tensor) -> tuple[Tensor, Tensor]:
        """Returns mean and logvar, (1, batch, width)."""
        frames = self.into(features).transpose(0, 1)
        x = torch.cat([self.summary.expand(-1, frames.shape[1], -1), frames])
        visible = padding.new_zeros(len(padding), 2)
        x = self.encoder(x + self.places[0, : len(x)], torch.cat([visible, padding], dim=1))
        return x[:1], x[1:2]

    def decode(self, z: Tensor, padding: Tensor) -> Tensor:
        """Returns (batch, frames, features)."""
        queries = self.places[1, : padding.shape[1]].expand(-1, z.shape[1], -1)
        return self.out(self.decoder(queries, padding, z)).transpose(0, 1)


class TextLayer(nn.Module):
    """Of CLIP: normalized first, causal, on fused attention, as `transformers` runs it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.heads = width // 64
        self.into, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.first, self.second = nn.Linear(width, 4 * width), nn.Linear(4 * width, width)
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(2))

    def forward(self, x: Tensor) -> Tensor:
        """Returns (batch, words, width)."""
        split = self.into(self.norms[0](x)).unflatten(2, (3, self.heads, 64))
        seen = F.scaled_dot_product_attention(*split.permute(2, 0, 3, 1, 4), is_causal=True)
        x = x + self.out(seen.transpose(1, 2).flatten(2))
        hidden = self.first(self.norms[1](x))
        return x + self.second(hidden * torch.sigmoid(1.702 * hidden))


class TextTower(nn.Module):
    """Of the size of CLIP's: of ViT-L/14 for width 768, of ViT-B/32 for 512."""

    def __init__(self, width: int = TEXT_WIDTH) -> None:
        super().__init__()
        self.words = nn.Embedding(WORDS, width)
        self.places = nn.Embedding(TEXT_TOKENS, width)
        self.layers = nn.Sequential(*(TextLayer(width) for _ in range(TEXT_LAYERS)))
        self.norm = nn.LayerNorm(width)
        self.project = nn.Linear(width, width, bias=False)

    def forward(self, words: Tensor) -> Tensor:
        """Returns (batch, width)."""
        states = self.layers(self.words(words) + self.places.weight)
        return self.project(self.norm(states)[:, -1])


class Denoiser(nn.Module):
    """Latent, time and sentence as three tokens."""

    def __init__(self) -> None:
        super().__init__()
        self.text = nn.Sequential(nn.ReLU(), nn.Linear(TEXT_WIDTH, WIDTH))
        self.time = nn.Sequential(nn.Linear(TEXT_WIDTH, WIDTH), nn.SiLU(), nn.Linear(WIDTH, WIDTH))
        self.places = nn.Parameter(torch.rand(3, 1, WIDTH))
        self.body = Skips()

    def forward(self, z: Tensor, t: Tensor, sentence: Tensor) -> Tensor:
        """Returns (1, batch, width)."""
        time = self.time(sines(t, TEXT_WIDTH))
        x = torch.cat([z, time[None], self.text(sentence)[None]])
        return self.body(x + self.places)[:1]


def sines(t: Tensor, width: int) -> Tensor:
    """Returns cosines and sines of times, (batch, width)."""
    angles = t[:, None] * torch.exp(-9.21 * torch.arange(width // 2) / (width // 2))
    return torch.cat([angles.cos(), angles.sin()], dim=1)


def random_words(sentences: int) -> Tensor:
    """Returns what a tokenizer gives, padded to the full length."""
    return torch.randint(WORDS, (sentences, TEXT_TOKENS))
