"""Training steps with the shapes of the authors' code, written from the paper and measurements.

What costs time there and not here: `nn.MultiheadAttention` with its default `need_weights=True`
(attention maps are materialized, fused kernels are off), a second encoding of the reconstruction
that is thrown away together with its graph, and in stage 2 the VAE's and CLIP's passes at every
step, on 77 tokens however short the sentence. Sequence first, as there.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor, nn

WIDTH, LAYERS, HEADS, HIDDEN, DROPOUT = 256, 9, 4, 1024, 0.1
TEXT_WIDTH, TEXT_LAYERS, TEXT_HEADS, TEXT_TOKENS = 768, 12, 12, 77


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


class TextTower(nn.Module):
    """Of the size of CLIP ViT-L/14's, random weights."""

    def __init__(self) -> None:
        super().__init__()
        layer = nn.TransformerEncoderLayer(
            TEXT_WIDTH, TEXT_HEADS, 4 * TEXT_WIDTH, activation="gelu", batch_first=True
        )
        self.words = nn.Embedding(49408, TEXT_WIDTH)
        self.layers = nn.TransformerEncoder(layer, TEXT_LAYERS, enable_nested_tensor=False)

    def forward(self, words: Tensor) -> Tensor:
        """Returns (batch, width)."""
        causal = nn.Transformer.generate_square_subsequent_mask(words.shape[1])
        return self.layers(self.words(words), mask=causal, is_causal=True)[:, -1]


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
        angles = t[:, None] * torch.exp(-9.21 * torch.arange(TEXT_WIDTH // 2) / (TEXT_WIDTH // 2))
        time = self.time(torch.cat([angles.cos(), angles.sin()], dim=1))
        x = torch.cat([z, time[None], self.text(sentence)[None]])
        return self.body(x + self.places)[:1]


def first_stage(features: Tensor, joints_of: Callable[[Tensor], Tensor]) -> Callable[[], None]:
    """Returns a step of stage 1 on these features."""
    vae = VAE(features.shape[2], features.shape[1])
    optimizer = torch.optim.AdamW(vae.parameters(), 1e-4)
    padding = torch.zeros(features.shape[:2], dtype=torch.bool)

    def step() -> None:
        mean, logvar = vae.encode(features, padding)
        z = mean + (logvar / 2).exp() * torch.randn_like(mean)
        rebuilt = vae.decode(z, padding)
        thrown_away = vae.encode(rebuilt, padding)
        divergence = (mean**2 + logvar.exp() - 1 - logvar).mean() / 2
        loss = F.smooth_l1_loss(rebuilt, features) + 1e-4 * divergence
        loss = loss + F.smooth_l1_loss(joints_of(rebuilt), joints_of(features))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        del thrown_away

    return step


def second_stage(features: Tensor) -> Callable[[], None]:
    """Returns a step of stage 2 on these features and as many sentences."""
    vae, text, denoiser = VAE(features.shape[2], features.shape[1]), TextTower(), Denoiser()
    optimizer = torch.optim.AdamW(denoiser.parameters(), 1e-4)
    padding = torch.zeros(features.shape[:2], dtype=torch.bool)
    words = torch.randint(49408, (len(features), TEXT_TOKENS))
    signal = torch.cumprod(1 - torch.linspace(0.00085**0.5, 0.012**0.5, 1000) ** 2, 0)

    def step() -> None:
        with torch.no_grad():
            mean, logvar = vae.encode(features, padding)
            z = mean + (logvar / 2).exp() * torch.randn_like(mean)
            sentence = text(words)
        epsilon, t = torch.randn_like(z), torch.randint(1000, (len(features),))
        weight = signal[t][None, :, None]
        noisy = weight.sqrt() * z + (1 - weight).sqrt() * epsilon
        loss = F.mse_loss(denoiser(noisy, t.float(), sentence), epsilon)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()

    return step
