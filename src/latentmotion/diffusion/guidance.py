"""Guidance: a denoiser around a denoiser, in two passes, or in one for a distilled model.

Classifier-free (Ho & Salimans 2022; paper eq. 6): output = u + scale (c - u), where c is the answer
with the condition and u the one without. A distilled model has learned that sum for any scale.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jaxtyping import Bool, Float

from latentmotion.arrays import array_namespace
from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.interface import Denoiser
from latentmotion.diffusion.leaps import Leap


@dataclass(frozen=True)
class ClassifierFreeGuidance:
    """Asks with and without the condition in one pass of twice the batch."""

    denoiser: Denoiser
    null: Conditioning
    """No condition, one row."""
    scale: float | Float[Any, " batch"]
    """1 follows the condition, more exaggerates it; one for all or one per item."""

    def __call__(
        self,
        z: Float[Any, "batch tokens width"],
        t: Float[Any, " batch"],
        condition: Conditioning,
        mask: Bool[Any, "batch tokens"],
    ) -> Float[Any, "batch tokens width"]:
        """Returns the guided output."""
        if isinstance(self.scale, (int, float)) and self.scale == 1:
            return self.denoiser(z, t, condition, mask)
        xp = array_namespace(z)
        null, condition = align(repeat(self.null, z.shape[0]), condition)
        both = Conditioning(
            xp.concat([null.tokens, condition.tokens]), xp.concat([null.mask, condition.mask])
        )
        z2, t2, mask2 = xp.concat([z, z]), xp.concat([t, t]), xp.concat([mask, mask])
        output = self.denoiser(z2, t2, both, mask2)
        without, with_condition = output[: z.shape[0]], output[z.shape[0] :]
        scale: Any = self.scale
        scale = scale[:, None, None] if getattr(scale, "ndim", 0) else scale
        return without + scale * (with_condition - without)


@dataclass(frozen=True)
class GuidanceAsInput:
    """Tells a distilled denoiser the scale and its stride: one pass, whatever the scale."""

    denoiser: Callable[..., Any]
    """A denoiser whose last argument is a `Leap`."""
    scale: float | Float[Any, " batch"]
    """As above."""
    steps: int
    """In how many steps it shall go the whole way."""

    def __call__(
        self,
        z: Float[Any, "batch tokens width"],
        t: Float[Any, " batch"],
        condition: Conditioning,
        mask: Bool[Any, "batch tokens"],
    ) -> Float[Any, "batch tokens width"]:
        """Returns the answer for that leap."""
        leap = Leap(0 * t + self.scale, 0 * t + 1 / self.steps)
        return self.denoiser(z, t, condition, mask, leap)


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


def align(one: Conditioning, other: Conditioning) -> tuple[Conditioning, Conditioning]:
    """Pads the one with fewer words, so that both have the same number."""
    words = max(one.mask.shape[1], other.mask.shape[1])
    return _pad(one, words), _pad(other, words)


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
