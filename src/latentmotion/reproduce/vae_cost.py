"""Cost of a VAE: parameters, latent numbers, and the times of a training step and of decoding.

Times are CPU time, which other work on the machine affects less than wall-clock time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

import torch

from latentmotion.evaluation.metrics.cost import parameters
from latentmotion.evaluation.report import Figure
from latentmotion.networks.vae.interface import MotionVAE

SECONDS = 4
"""Length of the motion that is decoded."""

BATCH, FRAMES = 32, 64
"""Motions of the training step, and their length."""

TIMED = 10
"""Repetitions of each measurement; the first half warms up."""


def vae_cost(vae: MotionVAE, features: int, fps: float) -> dict[str, Figure]:
    """Measures a VAE on PyTorch, on the CPU, in float32.

    Args:
        vae: The network.
        features: Numbers per frame.
        fps: Frames per second of its motions.
    """
    mask = torch.ones(1, round(SECONDS * fps), dtype=torch.bool)
    tokens = int(vae.latent_mask(mask).sum())
    latents = torch.zeros(1, tokens, vae.latent_width)
    batch = torch.zeros(BATCH, FRAMES, features)

    def train() -> None:
        """Forward and backward, without the optimizer."""
        real = torch.ones(batch.shape[:2], dtype=torch.bool)
        vae.decode(vae.encode(batch, real).mean, real).square().mean().backward()
        vae.zero_grad()

    return {
        "Parameters": Figure(parameters(vae) / 1e6),
        "Latent numbers": Figure(tokens * vae.latent_width),
        "Training step": Figure(_seconds(train)),
        "Decoding": Figure(1000 * _seconds(torch.no_grad()(lambda: vae.decode(latents, mask)))),
    }


def _seconds(action: Callable[[], object]) -> float:
    """Returns the median CPU time."""
    times = []
    for _ in range(TIMED):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return median(times[TIMED // 2 :])
