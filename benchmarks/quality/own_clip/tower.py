"""The motion tower: convolutions over positions and velocities, pooled by attention."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from latentmotion.networks.text_encoder import pack

# Frozen weights; `python -m benchmarks.quality.own_clip.train` wrote them.
WEIGHTS = Path(__file__).with_name("tower.safetensors")

SCALE = ".scale"  # Ending of the names of scales.

CHANNELS = np.r_[0:67, 193:259]  # Root, positions and velocities among HumanML3D's 263 features.

WIDTH = 192  # Width of the hidden layers and of the vector.

LONGEST = 200  # Frames that are read of a longer motion.


class Block(nn.Module):
    """A residual convolution; `dilation` frames between its taps."""

    def __init__(self, dilation: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(WIDTH)
        self.conv = nn.Conv1d(WIDTH, WIDTH, 3, padding=dilation, dilation=dilation)
        self.out = nn.Linear(WIDTH, WIDTH)

    def forward(self, x: Float[Tensor, "b t w"], mask: Bool[Tensor, "b t"]) -> Tensor:
        """Returns x with what its neighbors in time add."""
        inner = (self.norm(x) * mask[..., None]).transpose(1, 2)
        return x + self.out(nn.functional.gelu(self.conv(inner).transpose(1, 2)))


class Tower(nn.Module):
    """Motions to unit vectors."""

    mean: Tensor
    std: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(len(CHANNELS)))
        self.register_buffer("std", torch.ones(len(CHANNELS)))
        self.stem = nn.Conv1d(len(CHANNELS), WIDTH, 4, stride=4)
        self.blocks = nn.ModuleList(Block(dilation) for dilation in (1, 2, 4, 1))
        self.norm = nn.LayerNorm(WIDTH)
        self.weight = nn.Linear(WIDTH, 8)
        self.out = nn.Linear(8 * WIDTH, WIDTH)

    def forward(self, x: Float[Tensor, "b t c"], mask: Bool[Tensor, "b t"]) -> Tensor:
        """Returns one unit vector for each motion; frames where `mask` is false do not count."""
        x = ((x - self.mean) / self.std).clamp(-8, 8) * mask[..., None]
        x = self.stem(x.transpose(1, 2)).transpose(1, 2)
        mask = mask[:, 3::4]
        for block in self.blocks:
            x = block(x, mask)
        x = self.norm(x)
        weights = self.weight(x).masked_fill(~mask[..., None], -torch.inf).softmax(dim=1)
        pooled = torch.einsum("bth,btw->bhw", weights, x).flatten(1)
        return nn.functional.normalize(self.out(pooled), dim=-1)

    @torch.no_grad()
    def embed(
        self, motions: Sequence[Float[np.ndarray, "_ features"]]
    ) -> Float[np.ndarray, "motions width"]:
        """Returns the vectors of motions, given as HumanML3D's features in their own units."""
        vectors = []
        for features in motions:
            frames = min(len(features), LONGEST) // 4 * 4
            x = torch.from_numpy(features[None, :frames, CHANNELS].astype(np.float32))
            vectors.append(self(x, torch.ones(1, frames, dtype=torch.bool)))
        return torch.cat(vectors).numpy()

    def save(self, path: Path) -> None:
        """Writes the weights: matrices in 8 bits with a scale for each row, the rest in 16."""
        weights = {}
        for name, each in self.state_dict().items():
            if each.ndim < 2:
                weights[name] = each.half()
                continue
            codes, scale = pack(each.flatten(1))
            weights[name], weights[name + SCALE] = codes.view(each.shape), scale.half()
        save_file({name: each.contiguous() for name, each in weights.items()}, path)

    @classmethod
    def load(cls, path: Path = WEIGHTS) -> Tower:
        """Reads the weights."""
        tower, kept = cls(), load_file(path)
        weights = {
            name: (each.flatten(1) * kept[name + SCALE]).view(each.shape)
            if name + SCALE in kept
            else each
            for name, each in kept.items()
            if not name.endswith(SCALE)
        }
        tower.load_state_dict({name: each.float() for name, each in weights.items()})
        return tower.eval()
