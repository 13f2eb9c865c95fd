"""What each stage minimizes, once: two functions of the size of the equations in the paper.

Stage 1 (section 3.1):  L = |x̂ − x| + |joints(x̂) − joints(x)| + w KL(q(z | x) ‖ N(0, 1))
Stage 2 (eq. 4):        L = ‖target − denoiser(z_t, t, condition)‖²,  z_t = α z₀ + σ ε
Every mean is taken over the real frames of a motion and then over motions, so that padding weighs
nothing and a batch split among ranks has the loss of the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.guidance import drop
from latentmotion.diffusion.prediction import Epsilon, Sample, Velocity, add_noise
from latentmotion.diffusion.schedule import LinearPath, ScaledLinear
from latentmotion.training.randomness import StepRandomness
from latentmotion.vae.interface import MotionVAE

Joints = Callable[[Tensor], Tensor]
"""Normalized features (batch, frames, features) to joints (batch, frames, joints, 3), meters."""


@dataclass(frozen=True)
class VAEObjective:
    """Weights of the losses of stage 1; the defaults are the authors'."""

    features: float = 1.0
    """Weight of the smooth L1 distance of normalized features."""
    joints: float = 1.0
    """Weight of the smooth L1 distance of joints in the world, meters."""
    steps: float = 0.0
    """Weight of the same of joints' steps from frame to frame, meters times the frame rate."""
    divergence: float = 1e-4
    """Weight of the divergence from N(0, 1), per latent number."""
    joints_knee: float = 1.0
    """Distance in meters from which the joints' losses are linear."""


@dataclass(frozen=True)
class DenoiserObjective:
    """What the denoiser learns; the defaults are the paper's."""

    schedule: ScaledLinear | LinearPath = field(default_factory=ScaledLinear)
    """Noise schedule."""
    prediction: Epsilon | Sample | Velocity = field(default_factory=Epsilon)
    """What the network predicts."""
    times: Literal["uniform", "logit_normal"] = "uniform"
    """How times are drawn; logit-normal (Esser et al. 2024) prefers the middle of the way."""
    dropped: float = 0.1
    """Share of motions that are shown without their condition."""


@dataclass(frozen=True)
class LatentBatch:
    """Posteriors of a batch of motions and what is said of them."""

    mean: Float[Tensor, "batch tokens width"]
    """Means, normalized per channel."""
    std: Float[Tensor, "batch tokens width"]
    """Standard deviations, in the same scale."""
    mask: Bool[Tensor, "batch tokens"]
    """True on real tokens."""
    condition: Conditioning
    """What steers each motion."""


def vae_losses(
    vae: MotionVAE,
    features: Float[Tensor, "batch frames features"],
    mask: Bool[Tensor, "batch frames"],
    joints_of: Joints,
    objective: VAEObjective,
    randomness: StepRandomness,
    fps: float,
) -> dict[str, Tensor]:
    """Encodes, draws, decodes and compares (stage 1)."""
    posterior = vae.encode(features, mask)  #                        (batch, tokens, width)
    noise = randomness.normal(*posterior.mean.shape[1:])
    latents = posterior.mean + posterior.std * noise
    rebuilt = vae.decode(latents, mask).float()  #                   (batch, frames, features)
    true, found = joints_of(features), joints_of(rebuilt)  #         (batch, frames, joints, 3)
    steps = fps * found.diff(dim=1), fps * true.diff(dim=1)
    knee = objective.joints_knee
    losses = {
        "features": _mean(F.smooth_l1_loss(rebuilt, features, reduction="none"), mask),
        "joints": _mean(F.smooth_l1_loss(found, true, reduction="none", beta=knee), mask),
        "steps": _mean(F.smooth_l1_loss(*steps, reduction="none", beta=knee * fps), mask[:, 1:]),
        "divergence": _mean(posterior.divergence().float(), vae.latent_mask(mask)),
    }
    return {"total": sum_weighted(losses, objective), **losses}


def denoiser_losses(
    denoiser: nn.Module,
    batch: LatentBatch,
    null: Conditioning,
    objective: DenoiserObjective,
    randomness: StepRandomness,
) -> dict[str, Tensor]:
    """Adds noise to drawn latents and asks the network for its target (stage 2)."""
    shape = batch.mean.shape[1:]
    z0 = batch.mean + batch.std * randomness.normal(*shape)  #       (batch, tokens, width)
    epsilon = randomness.normal(*shape)
    t = draw_times(objective, randomness)  #                         (batch,)
    z = add_noise(z0, epsilon, t, objective.schedule)
    condition = drop(batch.condition, null, randomness.chance(objective.dropped))
    output = denoiser(z, t, condition, batch.mask).float()
    target = objective.prediction.target(z0, epsilon, t, objective.schedule)
    return {"total": _mean(F.mse_loss(output, target, reduction="none"), batch.mask)}


def draw_times(objective: DenoiserObjective, randomness: StepRandomness) -> Float[Tensor, " batch"]:
    """Draws a time of the schedule for each motion."""
    if objective.times == "logit_normal":
        return objective.schedule.at(torch.sigmoid(randomness.normal()))
    return objective.schedule.at(randomness.uniform())


def sum_weighted(losses: dict[str, Tensor], weights: VAEObjective) -> Tensor:
    """Returns the sum of the losses, each times the weight of its name."""
    return torch.stack([getattr(weights, name) * loss for name, loss in losses.items()]).sum()


def _mean(values: Float[Tensor, "batch length ..."], mask: Bool[Tensor, "batch length"]) -> Tensor:
    """Mean over the real part of each row, then over rows."""
    weights = mask / mask.sum(dim=1, keepdim=True)
    return (values.flatten(2).mean(dim=2) * weights).sum(dim=1).mean()
