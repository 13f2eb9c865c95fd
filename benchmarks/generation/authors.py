"""Generation in the authors' shapes and order of work, as a contender; a reference for time only.

    sentences and as many empty ones, padded to 77 words → text tower
    1 latent token, guided by a batch of twice the size, DDIM → decoder → joints

Each step computes the embeddings of time and text anew. Random weights and words; what the
schedule's numbers are changes no time.
"""

from __future__ import annotations

import torch
from torch import Tensor

from benchmarks.harness.authors_networks import VAE, WIDTH, Denoiser, TextTower, random_words
from benchmarks.harness.stopwatch import Laps, Stopwatch
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES

FEATURES, LONGEST, SCALE = 263, 500, 7.5


class AuthorsGeneration:
    """Motions of one length from noise and words.

    Args:
        batch: Motions that go through the networks together.
        frames: Their length.
        steps: Sampling steps.
    """

    def __init__(self, batch: int, frames: int, steps: int) -> None:
        self.text, self.denoiser = TextTower().eval(), Denoiser().eval()
        self.vae = VAE(FEATURES, LONGEST - 2).eval()
        self.mean, self.std = torch.zeros(FEATURES), torch.full((FEATURES,), 0.1)
        self.batch, self.steps = batch, steps
        self.padding = torch.zeros(batch, frames, dtype=torch.bool)
        noise = torch.linspace(0.00085**0.5, 0.012**0.5, 1000) ** 2
        self.signal = torch.cumprod(1 - noise, 0)

    @torch.no_grad()
    def __call__(self) -> Laps:
        """Makes them once."""
        watch = Stopwatch()
        sentences = self.text(random_words(2 * self.batch))
        watch.lap("text")
        latents = self._latents(sentences)
        watch.lap("denoiser")
        features = self.vae.decode(latents, self.padding)
        watch.lap("decoder")
        HUMANML3D_FEATURES.decode(features * self.std + self.mean)
        watch.lap("joints")
        return watch.laps

    def _latents(self, sentences: Tensor) -> Tensor:
        z = torch.randn(1, self.batch, WIDTH)
        stride = len(self.signal) // self.steps
        for t in range(stride * (self.steps - 1), -1, -stride):
            twice, times = torch.cat([z, z], dim=1), torch.full((2 * self.batch,), float(t))
            without, seen = self.denoiser(twice, times, sentences).chunk(2, dim=1)
            epsilon = without + SCALE * (seen - without)
            z = _step(z, epsilon, self.signal[t], self.signal[max(t - stride, 0)])
        return z


def _step(z: Tensor, epsilon: Tensor, now: Tensor, then: Tensor) -> Tensor:
    """One step of DDIM between two shares of signal."""
    clean = (z - (1 - now).sqrt() * epsilon) / now.sqrt()
    return then.sqrt() * clean + (1 - then).sqrt() * epsilon
