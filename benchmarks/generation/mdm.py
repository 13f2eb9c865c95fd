"""Generation in MDM's shape (Tevet et al. 2023), as a contender; a reference for time only.

    [time + sentence, frames] → 8 layers of 512 → frames, 1000 or 50 times, guided in two passes

Steps are all alike, so that some are run and the time of all is reckoned from them. The sentence is
encoded once, by a tower of the size of CLIP ViT-B/32's. Random weights and words.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from benchmarks.harness.authors_networks import TextTower, random_words, sines
from benchmarks.harness.stopwatch import Laps, Stopwatch
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES

FEATURES, WIDTH, LAYERS, HEADS, HIDDEN, SCALE = 263, 512, 8, 4, 1024, 2.5


class Network(nn.Module):
    """Predicts clean frames."""

    def __init__(self) -> None:
        super().__init__()
        layer = nn.TransformerEncoderLayer(WIDTH, HEADS, HIDDEN, activation="gelu")
        self.body = nn.TransformerEncoder(layer, LAYERS, enable_nested_tensor=False)
        self.into, self.out = nn.Linear(FEATURES, WIDTH), nn.Linear(WIDTH, FEATURES)
        self.time = nn.Sequential(nn.Linear(WIDTH, WIDTH), nn.SiLU(), nn.Linear(WIDTH, WIDTH))
        self.text = nn.Linear(WIDTH, WIDTH)

    def forward(self, x: Tensor, t: Tensor, sentence: Tensor) -> Tensor:
        """Returns (frames, batch, features)."""
        first = self.time(sines(t, WIDTH)) + self.text(sentence)
        frames = self.into(x)
        places = sines(torch.arange(len(x) + 1.0), WIDTH)[:, None]
        return self.out(self.body(torch.cat([first[None], frames]) + places)[1:])


@dataclass(frozen=True)
class MDMGeneration:
    """Motions of one length from noise and words."""

    text: TextTower  # Words to sentences.
    network: Network  # What is asked at each step.
    batch: int  # Motions that go through the network together.
    frames: int  # Their length.
    steps: int  # Sampling steps.
    run: int  # How many of them are run; the time of the others is reckoned.

    @classmethod
    def build(cls, batch: int, frames: int, steps: int, run: int) -> MDMGeneration:
        """Draws the weights."""
        return cls(TextTower(WIDTH).eval(), Network().eval(), batch, frames, steps, run)

    @torch.no_grad()
    def __call__(self) -> Laps:
        """Makes them once."""
        watch = Stopwatch()
        sentences = self.text(random_words(self.batch))
        watch.lap("text")
        x = torch.randn(self.frames, self.batch, FEATURES)
        for t in range(self.run):
            times = torch.full((self.batch,), float(t))
            seen, without = (self.network(x, times, s) for s in (sentences, 0 * sentences))
            x = 0.1 * (without + SCALE * (seen - without)) + 0.1 * torch.randn_like(x)
        watch.lap("denoiser")
        HUMANML3D_FEATURES.decode(x.transpose(0, 1))
        watch.lap("joints")
        return watch.laps | {"denoiser": watch.laps["denoiser"] * self.steps / self.run}
