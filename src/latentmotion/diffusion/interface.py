"""What a denoiser is to a sampler: a function of the noisy latents, the time and the condition."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.condition.interface import Conditioning

Noise = Callable[[tuple[int, ...]], np.ndarray]
"""Draws standard normal numbers of a shape, float32, always on the CPU and in NumPy."""

Estimates = tuple[Any, Any]
"""Estimates of (z_0, epsilon), each of shape (batch, tokens, width)."""

Estimate = Callable[[Any, float], Estimates]
"""Estimates from a batch of latents at one time, its condition and mask being settled."""


@runtime_checkable
class Denoiser(Protocol):
    """Any network, runtime session or closed form that predicts from noisy latents."""

    def __call__(
        self,
        z: Float[Any, "batch tokens width"],
        t: Float[Any, " batch"],
        condition: Conditioning,
        mask: Bool[Any, "batch tokens"],
    ) -> Float[Any, "batch tokens width"]:
        """Returns what its `Parametrization` says: noise, clean latents or velocity.

        Args:
            z: Noisy latents, NumPy or torch.
            t: Time of each item, in the units of the schedule.
            condition: What steers the motion, one row per item.
            mask: True on real tokens.
        """
        ...


@runtime_checkable
class Estimator(Protocol):
    """A denoiser with the meaning of its output: what a sampler asks at every step."""

    def __call__(
        self,
        z: Float[Any, "batch tokens width"],
        t: float,
        condition: Conditioning,
        mask: Bool[Any, "batch tokens"],
    ) -> Estimates:
        """Returns the estimates of (z_0, epsilon).

        Args:
            z: Noisy latents, NumPy or torch.
            t: Time of all items, in the units of the schedule.
            condition: What steers the motion, one row per item.
            mask: True on real tokens.
        """
        ...
