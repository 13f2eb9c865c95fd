"""Latents whose decoded features are given ones, found through the decoder, without an encoder.

The squared error of normalized features is minimized by L-BFGS (Liu & Nocedal 1989). That takes one
row of the decoder's pullback a step, and comes nearer to the motion than encoding it does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from latentmotion.control.reach import DecodedMotion

_MEMORY = 12
"""Steps that L-BFGS remembers."""


def fit_latents(
    motion: DecodedMotion,
    joints: Float[np.ndarray, "frames joints 3"],
    iterations: int = 60,
) -> Float[np.ndarray, "tokens width"]:
    """Returns latents, in the denoiser's scale, whose motion moves as the joints do.

    Args:
        motion: As long as the joints.
        joints: Positions, meters, of the model's skeleton.
        iterations: Steps at most.
    """
    # The last frame has no velocity; the one before is kept.
    ahead = joints[-1:] + (joints[-1:] - joints[-2:-1])
    wanted = motion.representation.encode(np.concatenate([joints, ahead]))
    return fit_features(motion, wanted, np.ones(wanted.shape), 0.0, iterations)


def fit_features(
    motion: DecodedMotion,
    wanted: Float[np.ndarray, "frames features"],
    weights: Float[np.ndarray, "frames features"],
    prior: float,
    iterations: int,
) -> Float[np.ndarray, "tokens width"]:
    """Returns latents, in the denoiser's scale, whose features are near given ones.

    Args:
        motion: As long as the features.
        wanted: The features, in their own units; all of them, or the first ones.
        weights: How much each of them counts.
        prior: How much a latent counts that is not 0, beside a normalized feature.
        iterations: Steps at most.
    """
    wanted, count = np.asarray(wanted, np.float64), wanted.shape[1]
    std = np.broadcast_to(motion.features.std, motion.representation.width)[:count]
    weight, prior = weights / (std * std * wanted.size), prior / wanted.size
    width = latent_width(motion)

    def loss(z: Float[np.ndarray, " numbers"]) -> tuple[float, Float[np.ndarray, " numbers"]]:
        latents = z.reshape(-1, width)
        gap = motion.decode(latents)[:, :count] - wanted
        slope = motion.features_pullback(latents, (gap * weight)[None])
        value = float((gap * gap * weight).sum() + prior * (z @ z))
        return 0.5 * value, slope.astype(np.float64).ravel() + prior * z

    tokens = -(-len(wanted) // 4)
    return lbfgs(loss, np.zeros(tokens * width), iterations).reshape(tokens, width)


def latent_width(motion: DecodedMotion) -> int:
    """Returns how many numbers a token has."""
    return int(np.broadcast_to(motion.latents.std, motion.latents.mean.shape).size)


def lbfgs(
    loss: Callable[[np.ndarray], tuple[float, np.ndarray]],
    start: Float[np.ndarray, " numbers"],
    iterations: int,
    memory: int = _MEMORY,
) -> Float[np.ndarray, " numbers"]:
    """Returns where a function is small: L-BFGS with steps that are halved until they help.

    Args:
        loss: Value and gradient.
        start: Where it begins.
        iterations: Steps at most.
        memory: Steps that are remembered.
    """
    x, (value, slope) = start, loss(start)
    history: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(iterations):
        direction, factors = -slope, []
        for step, bend in reversed(history):
            factors.append((step @ direction) / (step @ bend))
            direction = direction - factors[-1] * bend
        if history:
            step, bend = history[-1]
            direction = direction * (step @ bend) / (bend @ bend)
        else:
            direction = direction / max(float(np.sqrt(np.mean(slope**2))), 1e-12) * 0.1
        for (step, bend), factor in zip(history, reversed(factors), strict=True):
            direction = direction + step * (factor - (bend @ direction) / (step @ bend))
        size = 1.0
        while size > 1e-3:
            after, after_slope = loss(x + size * direction)
            if after < value + 1e-4 * size * float(slope @ direction):
                break
            size /= 2
        else:
            break
        step, bend = size * direction, after_slope - slope
        if step @ bend > 1e-12 * (bend @ bend):
            history = [*history[1 - memory :], (step, bend)]
        improved = value - after
        x, value, slope = x + step, after, after_slope
        if improved < 1e-5 * value:
            break
    return x
