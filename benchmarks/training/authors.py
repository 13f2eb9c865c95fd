"""Training steps in the authors' shapes and order of work, written from the paper and measurements.

What costs time there and not here, besides attention: a second encoding of the reconstruction that
is thrown away together with its graph, and in stage 2 the VAE's and CLIP's passes at every step, on
77 tokens however short the sentence.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from benchmarks.harness.authors_networks import VAE, Denoiser, TextTower, random_words


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
    words = random_words(len(features))
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
