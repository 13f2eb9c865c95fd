"""The interface of denoisers, and the meaning of their output: noise, clean latents or velocity.

With z_t = alpha z_0 + sigma epsilon each of the three determines (z_0, epsilon). A
`ParametrizedDenoiser` returns that pair, so neither samplers nor control know which one it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import array_namespace, device
from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.schedule import Schedule, Time

Latents = Float[Any, "batch tokens width"]
Times = Float[Any, " batch"]
Mask = Bool[Any, "batch tokens"]  # True on real tokens.

# Draws standard normal numbers of a shape, float32, always on the CPU and in NumPy.
Noise = Callable[[tuple[int, ...]], np.ndarray]

Estimates = tuple[Any, Any]  # Estimates of (z_0, epsilon), each of shape (batch, tokens, width).

# Estimates from a batch of latents at one time, its condition and mask being settled.
Estimate = Callable[[Any, float], Estimates]


@runtime_checkable
class Denoiser(Protocol):
    """Any network, runtime session or closed form that predicts from noisy latents."""

    def __call__(self, z: Latents, t: Times, condition: Conditioning, mask: Mask) -> Latents:
        """Returns what its `Parametrization` says: noise, clean latents or velocity.

        Args:
            z: Noisy latents, NumPy or torch.
            t: Time of each item, in the units of the schedule.
            condition: Condition of the motion, one row per item.
            mask: True on real tokens.
        """
        ...


# A denoiser with the meaning of its output, as samplers call it at every step: noisy latents, the
# time of all items, their condition, and a mask that is True on real tokens.
Estimator = Callable[[Latents, float, Conditioning, Mask], Estimates]


@runtime_checkable
class Parametrization(Protocol):
    """The meaning of a denoiser's output."""

    def to_x0_eps(self, output: Latents, z: Latents, t: Time, schedule: Schedule) -> Estimates:
        """Returns the estimates of (z_0, epsilon) from the network's output at z_t."""
        ...

    def target(self, z0: Latents, epsilon: Latents, t: Time, schedule: Schedule) -> Latents:
        """Returns the training target of the network's output."""
        ...


@dataclass(frozen=True)
class Epsilon:
    """The noise, as in the paper (eq. 4)."""

    def to_x0_eps(self, output: Latents, z: Latents, t: Time, schedule: Schedule) -> Estimates:
        """Returns z_0 = (z_t - sigma epsilon) / alpha, and epsilon itself."""
        alpha, sigma = _columns(schedule.alpha(t)), _columns(schedule.sigma(t))
        return (z - sigma * output) / alpha, output

    def target(self, z0: Latents, epsilon: Latents, t: Time, schedule: Schedule) -> Latents:
        """Returns epsilon."""
        return epsilon


@dataclass(frozen=True)
class Sample:
    """The clean latents."""

    def to_x0_eps(self, output: Latents, z: Latents, t: Time, schedule: Schedule) -> Estimates:
        """Returns z_0 itself, and epsilon = (z_t - alpha z_0) / sigma."""
        alpha, sigma = _columns(schedule.alpha(t)), _columns(schedule.sigma(t))
        return output, (z - alpha * output) / sigma

    def target(self, z0: Latents, epsilon: Latents, t: Time, schedule: Schedule) -> Latents:
        """Returns z_0."""
        return z0


@dataclass(frozen=True)
class Velocity:
    """c z_0 + d epsilon, with the schedule's velocity coefficients (c, d).

    On `LinearPath` that is dz/dt; on a variance-preserving schedule it is Salimans & Ho's v.
    In both alpha d - sigma c = 1, which makes the way back this short.
    """

    def to_x0_eps(self, output: Latents, z: Latents, t: Time, schedule: Schedule) -> Estimates:
        """Returns z_0 = d z_t - sigma v, and epsilon = alpha v - c z_t."""
        alpha, sigma = _columns(schedule.alpha(t)), _columns(schedule.sigma(t))
        c, d = map(_columns, schedule.velocity_coefficients(t))
        return d * z - sigma * output, alpha * output - c * z

    def target(self, z0: Latents, epsilon: Latents, t: Time, schedule: Schedule) -> Latents:
        """Returns the velocity of the path from z_0 to epsilon."""
        c, d = map(_columns, schedule.velocity_coefficients(t))
        return c * z0 + d * epsilon


@dataclass(frozen=True)
class ParametrizedDenoiser:
    """A denoiser with the meaning of its output: an `Estimator`."""

    denoiser: Denoiser  # Network or session, maybe with guidance around it.
    parametrization: Parametrization  # Meaning of its output.
    schedule: Schedule  # The noise schedule that it was trained on.

    def __call__(self, z: Latents, t: float, condition: Conditioning, mask: Mask) -> Estimates:
        """Returns the estimates of (z_0, epsilon) at one time for all items."""
        times = array_namespace(z).full((z.shape[0],), t, dtype=z.dtype, device=device(z))
        return self.estimates(self.denoiser(z, times, condition, mask), z, t)

    def estimates(self, output: Latents, z: Latents, t: Time) -> Estimates:
        """Returns the estimates of (z_0, epsilon) from the denoiser's output at z_t."""
        return self.parametrization.to_x0_eps(output, z, t, self.schedule)


def add_noise(z0: Latents, epsilon: Latents, t: Time, schedule: Schedule) -> Latents:
    """Returns z_t."""
    return _columns(schedule.alpha(t)) * z0 + _columns(schedule.sigma(t)) * epsilon


def _columns(weight: Any) -> Any:
    """One weight per item becomes a column that multiplies (batch, tokens, width)."""
    return weight[:, None, None] if getattr(weight, "ndim", 0) else weight
