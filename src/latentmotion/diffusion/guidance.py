"""Guidance: a denoiser around a denoiser, in two passes, or in one for a distilled model.

Classifier-free (Ho & Salimans 2022; paper eq. 6): output = u + scale (c - u), where c is the output
with the condition and u the one without. It exaggerates: "turn left" turns too far.

Projected (Sadat et al. 2025, "Eliminating oversaturation and artifacts of high guidance scales",
with its eta 0; limited to an interval as by Kynkäänniemi et al. 2024):

    output = c + (scale - 1) (d - z0 <d, z0> / <z0, z0>),  d = c - u

where z0 are the clean latents that c stands for. What is left out points along them, and would make
the motion larger instead of another one. At times outside of the interval, output = c.

A distilled model has learned its teacher's guidance for any scale.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from jaxtyping import Bool

from latentmotion.arrays import array_namespace
from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.parametrization import (
    Denoiser,
    Latents,
    Mask,
    ParametrizedDenoiser,
    Times,
)
from latentmotion.diffusion.schedule import StepCondition

GuidanceRule = Literal["classifier_free", "projected"]  # Guidance of a model that is not distilled.

# Shares of signal's loss, sigma / (alpha + sigma), between which projected guidance acts.
INTERVAL = (0.25, 0.95)


@dataclass(frozen=True)
class ClassifierFreeGuidance:
    """Evaluates with and without the condition in one pass of twice the batch."""

    denoiser: Denoiser
    null: Conditioning  # No condition, one row.
    # 1 follows the condition, more exaggerates it; one for all or one per item.
    scale: float | Times

    def __call__(self, z: Latents, t: Times, condition: Conditioning, mask: Mask) -> Latents:
        """Returns the guided output."""
        if isinstance(self.scale, (int, float)) and self.scale == 1:
            return self.denoiser(z, t, condition, mask)
        unconditional, conditional = _both(self.denoiser, self.null, z, t, condition, mask)
        scale: Any = self.scale
        if getattr(scale, "ndim", 0):  # one per item becomes a column that multiplies the outputs
            scale = scale[:, None, None]
        return unconditional + scale * (conditional - unconditional)


@dataclass(frozen=True)
class ProjectedGuidance:
    """Guides only across the predicted clean latents, and only at middle noise levels."""

    parametrized: ParametrizedDenoiser  # The denoiser, with the meaning of its output.
    null: Conditioning  # No condition, one row.
    # 1 follows the condition, more exaggerates it; one for all or one per item.
    scale: float | Times
    # Least and greatest share of noise, sigma / (alpha + sigma), at which guidance acts.
    interval: tuple[float, float] = INTERVAL

    def __call__(self, z: Latents, t: Times, condition: Conditioning, mask: Mask) -> Latents:
        """Returns the guided output."""
        if isinstance(self.scale, (int, float)) and self.scale == 1:
            return self.parametrized.denoiser(z, t, condition, mask)
        xp = array_namespace(z)
        unconditional, conditional = _both(
            self.parametrized.denoiser, self.null, z, t, condition, mask
        )
        clean, _ = self.parametrized.estimates(conditional, z, t)
        clean, difference = clean * mask[..., None], conditional - unconditional
        along = (difference * clean).sum(axis=(1, 2)) / ((clean * clean).sum(axis=(1, 2)) + 1e-8)
        across = difference - along[:, None, None] * clean
        schedule = self.parametrized.schedule
        alpha, sigma = schedule.alpha(t), schedule.sigma(t)
        lost, (least, most) = sigma / (alpha + sigma), self.interval
        acts = xp.asarray((lost >= least) & (lost <= most), dtype=z.dtype)
        return conditional + (acts * (self.scale - 1))[:, None, None] * across


def guided(
    rule: GuidanceRule, model: ParametrizedDenoiser, null: Conditioning, scale: float | Times
) -> ParametrizedDenoiser:
    """Returns a denoiser with guidance around it.

    Args:
        rule: Kind of guidance.
        model: A denoiser that is not distilled.
        null: No condition, one row.
        scale: Guidance scale, one for all or one per item.
    """
    if rule == "projected":
        return replace(model, denoiser=ProjectedGuidance(model, null, scale))
    return replace(model, denoiser=ClassifierFreeGuidance(model.denoiser, null, scale))


@dataclass(frozen=True)
class DistilledGuidance:
    """Guidance learned by a distilled denoiser: the scale is an input, and one pass is enough."""

    denoiser: Callable[..., Any]  # A denoiser whose last argument is a `StepCondition`.
    scale: float | Times  # Scale that is passed to the network; one for all or one per item.
    steps: int  # Number of sampling steps.

    def __call__(self, z: Latents, t: Times, condition: Conditioning, mask: Mask) -> Latents:
        """Returns the output for a step of that size."""
        step_condition = StepCondition(0 * t + self.scale, 0 * t + 1 / self.steps)
        return self.denoiser(z, t, condition, mask, step_condition)


def _both(
    denoiser: Denoiser,
    null: Conditioning,
    z: Latents,
    t: Times,
    condition: Conditioning,
    mask: Mask,
) -> tuple[Latents, Latents]:
    """Returns the outputs without and with the condition, from one pass of twice the batch."""
    xp = array_namespace(z)
    null, condition = align(repeat(null, z.shape[0]), condition)
    both = Conditioning(
        xp.concat([null.tokens, condition.tokens]), xp.concat([null.mask, condition.mask])
    )
    output = denoiser(xp.concat([z, z]), xp.concat([t, t]), both, xp.concat([mask, mask]))
    return output[: z.shape[0]], output[z.shape[0] :]


def drop(condition: Conditioning, null: Conditioning, dropped: Bool[Any, " batch"]) -> Conditioning:
    """Returns the condition with the rows where `dropped` is True replaced by `null`'s one row."""
    xp = array_namespace(condition.tokens)
    null, condition = align(repeat(null, condition.tokens.shape[0]), condition)
    tokens = xp.where(dropped[:, None, None], null.tokens, condition.tokens)
    return Conditioning(tokens, xp.where(dropped[:, None], null.mask, condition.mask))


def repeat(condition: Conditioning, rows: int) -> Conditioning:
    """Returns one row as `rows` equal ones."""
    xp = array_namespace(condition.tokens)
    tokens, mask = condition.tokens, condition.mask
    return Conditioning(
        xp.broadcast_to(tokens, (rows, *tokens.shape[1:])),
        xp.broadcast_to(mask, (rows, *mask.shape[1:])),
    )


def align(first: Conditioning, second: Conditioning) -> tuple[Conditioning, Conditioning]:
    """Pads the one with fewer words, so that both have the same number."""
    words = max(first.mask.shape[1], second.mask.shape[1])
    return _pad(first, words), _pad(second, words)


def _pad(condition: Conditioning, words: int) -> Conditioning:
    missing = words - condition.mask.shape[1]
    if missing == 0:
        return condition
    xp = array_namespace(condition.tokens)
    tokens = xp.zeros_like(condition.tokens[:, :1]), condition.mask[:, :1] & False
    return Conditioning(
        xp.concat([condition.tokens, *[tokens[0]] * missing], axis=1),
        xp.concat([condition.mask, *[tokens[1]] * missing], axis=1),
    )
