"""What a VAE costs: parameters, latent numbers, and the times of a training step and of decoding.

Times are CPU time, which other work on the machine moves less than it moves the clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

import torch
from torch import Tensor

from latentmotion.evaluation.metrics.cost import parameters
from latentmotion.evaluation.report import Figure
from latentmotion.vae.interface import MotionVAE

SECONDS = 4
"""Length of the motion that is decoded."""

BATCH, FRAMES = 32, 64
"""Motions of the training step, and their length."""

TIMED = 10
"""How often each is done; the first half warms up."""


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
    return {
        "Parameters": Figure(parameters(vae) / 1e6),
        "Latent numbers": Figure(tokens * vae.latent_width),
        "Training step": Figure(_seconds(lambda: _train(vae, batch))),
        "Decoding": Figure(1000 * _seconds(torch.no_grad()(lambda: vae.decode(latents, mask)))),
    }


def _train(vae: MotionVAE, features: Tensor) -> None:
    """Forward and backward, without the optimizer."""
    mask = torch.ones(features.shape[:2], dtype=torch.bool)
    vae.decode(vae.encode(features, mask).mean, mask).square().mean().backward()
    vae.zero_grad()


def _seconds(action: Callable[[], object]) -> float:
    times = []
    for _ in range(TIMED):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return median(times[TIMED // 2 :])
