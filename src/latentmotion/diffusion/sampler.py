"""From noise to latents: one loop, and how one step goes from time t to an earlier time s.

A sampler knows the schedule and what the network's output means, but never of guidance, which is a
denoiser around a denoiser.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, Protocol, runtime_checkable

from array_api_compat import array_namespace, device
from jaxtyping import Bool, Float

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.interface import Denoiser, Noise
from latentmotion.diffusion.prediction import Prediction
from latentmotion.diffusion.schedule import ScaledLinear, Schedule
from latentmotion.errors import InputError

Latents = Float[Any, "batch tokens width"]

SamplerName = Literal["ddim", "ddpm"]
"""Samplers that cards and the command line name."""


@runtime_checkable
class Sampler(Protocol):
    """A rule for one step."""

    @property
    def schedule(self) -> Schedule:
        """The noise schedule that it walks along."""
        ...

    def step(self, output: Latents, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns z_s from z_t and the denoiser's output there, s < t; mutates nothing."""
        ...


@dataclass(frozen=True)
class DDIM:
    """Song et al. 2021, eq. 12: keep the estimated noise, or with `eta` replace a part of it.

    On `LinearPath` with eta 0 it is Euler's method for the flow dz/dt.
    """

    schedule: Schedule
    prediction: Prediction
    eta: float = 0.0

    def step(self, output: Latents, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns alpha_s z_0 + sqrt(sigma_s² - fresh²) epsilon + fresh · noise."""
        z0, epsilon = self.prediction.split(output, z, t, self.schedule)
        alpha, sigma = self.schedule.alpha(s), self.schedule.sigma(s)
        if self.eta == 0:
            return alpha * z0 + sigma * epsilon
        fresh = self.eta * _posterior(self.schedule, t, s)[2]
        kept = (sigma**2 - fresh**2) ** 0.5
        return alpha * z0 + kept * epsilon + fresh * _like(z, noise)


@dataclass(frozen=True)
class DDPM:
    """Ho et al. 2020, eq. 6-7: draw from q(z_s | z_t, z_0), with its own variance (fixed small)."""

    schedule: Schedule
    prediction: Prediction

    def step(self, output: Latents, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns a draw from the posterior at `s`; at an end without noise, its mean."""
        z0, _ = self.prediction.split(output, z, t, self.schedule)
        of_z, of_z0, deviation = _posterior(self.schedule, t, s)
        mean = of_z * z + of_z0 * z0
        return mean + deviation * _like(z, noise) if deviation > 0 else mean


def sampler_named(name: SamplerName, schedule: Schedule, prediction: Prediction) -> Sampler:
    """Returns a sampler; DDPM walks the paper's schedule to its very end, as the authors' does.

    Raises:
        InputError: There is none of that name.
    """
    if name == "ddim":
        return DDIM(schedule, prediction)
    if name != "ddpm":
        raise InputError(f"unknown sampler {name!r}; known are ddim, ddpm")
    if isinstance(schedule, ScaledLinear):
        schedule = replace(schedule, offset=0, ends_clean=True)
    return DDPM(schedule, prediction)


def sample(
    denoiser: Denoiser,
    sampler: Sampler,
    z: Latents,
    condition: Conditioning,
    mask: Bool[Any, "batch tokens"],
    steps: int,
    noise: Noise,
) -> Latents:
    """Walks from pure noise to latents.

    Args:
        denoiser: Network, session or guidance around one.
        sampler: The rule for one step.
        z: Standard normal noise.
        condition: What steers the motion.
        mask: True on real tokens.
        steps: Number of steps, each one pass of the denoiser.
        noise: Draws further noise, where the sampler wants any.
    """
    xp = array_namespace(z)
    for t, s in pairwise(sampler.schedule.times(steps).tolist()):
        times = xp.full((z.shape[0],), t, dtype=z.dtype, device=device(z))
        z = sampler.step(denoiser(z, times, condition, mask), z, t, s, noise)
    return z


def _posterior(schedule: Schedule, t: float, s: float) -> tuple[float, float, float]:
    """Weights of z_t and z_0 in the mean of q(z_s | z_t, z_0), and its standard deviation.

    With a = alpha_t / alpha_s and b² = sigma_t² - a² sigma_s², the noise added between s and t:
    mean = (a sigma_s² z_t + alpha_s b² z_0) / sigma_t², deviation = b sigma_s / sigma_t.
    """
    sigma_t, sigma_s = schedule.sigma(t), schedule.sigma(s)
    a = schedule.alpha(t) / schedule.alpha(s)
    added = max(sigma_t**2 - (a * sigma_s) ** 2, 0.0)
    of_z = a * (sigma_s / sigma_t) ** 2
    of_z0 = schedule.alpha(s) * added / sigma_t**2
    return of_z, of_z0, added**0.5 * sigma_s / sigma_t


def _like(z: Latents, noise: Noise) -> Latents:
    return array_namespace(z).asarray(noise(tuple(z.shape)), dtype=z.dtype, device=device(z))
