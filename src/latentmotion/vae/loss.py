"""What the VAE minimizes (paper, section 3.1; the authors' code adds the joints).

L = |x̂ − x| + |joints(x̂) − joints(x)| + w KL(q(z | x) ‖ N(0, 1)),  smooth L1 distances
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from latentmotion.nn.masked import mean_of_real
from latentmotion.vae.interface import MotionVAE


@dataclass(frozen=True)
class VAEObjective:
    """Weights of the losses; the defaults are the authors'."""

    features: float = 1.0
    """Weight of the distance of normalized features."""
    joints: float = 1.0
    """Weight of the distance of joints in the world, meters."""
    steps: float = 0.0
    """Weight of the distance of joints' velocities, meters a second."""
    divergence: float = 1e-4
    """Weight of the divergence from N(0, 1), per latent number."""
    joints_knee: float = 1.0
    """Distance in meters from which the joints' loss grows linearly; before, as a square."""


def vae_losses(
    vae: MotionVAE,
    features: Float[Tensor, "batch frames features"],
    mask: Bool[Tensor, "batch frames"],
    noise: Callable[..., Tensor],
    joints_of: Callable[[Tensor], Tensor],
    fps: float,
    objective: VAEObjective,
) -> dict[str, Tensor]:
    """Encodes, draws, decodes and compares.

    Args:
        vae: The network.
        features: Normalized features.
        mask: True on real frames.
        noise: Draws standard normal numbers, a row of the given shape for each motion.
        joints_of: Normalized features to joints, (batch, frames, joints, 3), meters.
        fps: Frames per second.
        objective: Weights of the losses.

    Returns:
        "total", and each loss by the name of its weight.
    """
    posterior = vae.encode(features, mask)  #                        (batch, tokens, width)
    latents = posterior.mean + posterior.std * noise(*posterior.mean.shape[1:])
    rebuilt = vae.decode(latents, mask).float()  #                   (batch, frames, features)
    found, true = joints_of(rebuilt), joints_of(features)  #         (batch, frames, joints, 3)
    velocities = fps * found.diff(dim=1), fps * true.diff(dim=1)
    knee = objective.joints_knee
    losses = {
        "features": _distance(rebuilt, features, mask, 1.0),
        "joints": _distance(found, true, mask, knee),
        "steps": _distance(*velocities, mask[:, 1:], knee * fps),
        "divergence": mean_of_real(posterior.divergence().float(), vae.latent_mask(mask)),
    }
    weighted = [getattr(objective, name) * loss for name, loss in losses.items()]
    return {"total": torch.stack(weighted).sum(), **losses}


def _distance(found: Tensor, true: Tensor, mask: Tensor, knee: float) -> Tensor:
    return mean_of_real(F.smooth_l1_loss(found, true, reduction="none", beta=knee), mask)
