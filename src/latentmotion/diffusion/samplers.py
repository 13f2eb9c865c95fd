"""From noise to latents: how a sampler walks from time t to an earlier time s, again and again.

A sampler knows the schedule and what the network's output means, but never of guidance, which is a
denoiser around a denoiser. These ask once a step and remember nothing; `second_order` has others.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, Protocol, runtime_checkable

from jaxtyping import Bool, Float

from latentmotion.arrays import array_namespace, device
from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.interface import Denoiser, ModelOutput, Noise
from latentmotion.diffusion.parametrization import Parametrization
from latentmotion.diffusion.schedule import ScaledLinear, Schedule
from latentmotion.diffusion.second_order import DPMSolver, Heun
from latentmotion.errors import InputError

Latents = Float[Any, "batch tokens width"]

SamplerName = Literal["ddim", "euler", "ddpm", "heun", "dpm++"]
"""Samplers that cards and the command line name; `euler` is `ddim`, see there."""


@runtime_checkable
class Sampler(Protocol):
    """A rule for the way from noise to latents."""

    @property
    def schedule(self) -> Schedule:
        """The noise schedule that it walks along."""
        ...

    def integrate(
        self, model_output: ModelOutput, z: Latents, times: Sequence[float], noise: Noise
    ) -> Latents:
        """Returns the latents at the last of the descending `times`; mutates nothing.

        Args:
            model_output: The denoiser's output, given latents and one time for all of them.
            z: Latents at the first of the times.
            times: Where it stops over.
            noise: Draws further noise, where it wants any.
        """
        ...


class SingleStepSampler(ABC):
    """A sampler whose steps ask once each and know nothing of each other."""

    @abstractmethod
    def step(self, output: Latents, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns z_s from z_t and the denoiser's output there, s < t; mutates nothing."""

    def integrate(
        self, model_output: ModelOutput, z: Latents, times: Sequence[float], noise: Noise
    ) -> Latents:
        """Returns the latents at the last of the times."""
        for t, s in pairwise(times):
            z = self.step(model_output(z, t), z, t, s, noise)
        return z


@dataclass(frozen=True)
class DDIM(SingleStepSampler):
    """Song et al. 2021, eq. 12: keep the estimated noise, or with `eta` replace a part of it.

    With eta 0 it is Euler's method on every schedule: the flow is dz = z_0 dα + epsilon dσ, and
    z_t + (α_s - α_t) z_0 + (σ_s - σ_t) epsilon = α_s z_0 + σ_s epsilon, as z_t = α_t z_0 + σ_t
    epsilon.
    """

    schedule: Schedule
    parametrization: Parametrization
    eta: float = 0.0

    def step(self, output: Latents, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns alpha_s z_0 + sqrt(sigma_s² - fresh²) epsilon + fresh · noise."""
        z0, epsilon = self.parametrization.to_x0_eps(output, z, t, self.schedule)
        alpha, sigma = self.schedule.alpha(s), self.schedule.sigma(s)
        if self.eta == 0:
            return alpha * z0 + sigma * epsilon
        fresh = self.eta * _posterior(self.schedule, t, s)[2]
        kept = (sigma**2 - fresh**2) ** 0.5
        return alpha * z0 + kept * epsilon + fresh * _like(z, noise)


@dataclass(frozen=True)
class DDPM(SingleStepSampler):
    """Ho et al. 2020, eq. 6-7: draw from q(z_s | z_t, z_0), with its own variance (fixed small)."""

    schedule: Schedule
    parametrization: Parametrization

    def step(self, output: Latents, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns a draw from the posterior at `s`; at an end without noise, its mean."""
        z0, _ = self.parametrization.to_x0_eps(output, z, t, self.schedule)
        of_z, of_z0, deviation = _posterior(self.schedule, t, s)
        mean = of_z * z + of_z0 * z0
        return mean + deviation * _like(z, noise) if deviation > 0 else mean


def sampler_named(
    name: SamplerName, schedule: Schedule, parametrization: Parametrization
) -> Sampler:
    """Returns a sampler; DDPM walks the paper's schedule to its very end, as the authors' does.

    Raises:
        InputError: There is none of that name.
    """
    if name not in _SAMPLERS:
        raise InputError(f"unknown sampler {name!r}; known are {', '.join(_SAMPLERS)}")
    if name == "ddpm" and isinstance(schedule, ScaledLinear):
        schedule = replace(schedule, offset=0, ends_clean=True)
    return _SAMPLERS[name](schedule, parametrization)


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
        steps: Number of steps.
        noise: Draws further noise, where the sampler wants any.
    """
    xp = array_namespace(z)

    def model_output(z: Latents, t: float) -> Latents:
        times = xp.full((z.shape[0],), t, dtype=z.dtype, device=device(z))
        return denoiser(z, times, condition, mask)

    return sampler.integrate(model_output, z, sampler.schedule.timesteps(steps).tolist(), noise)


_SAMPLERS: dict[str, Callable[[Schedule, Parametrization], Sampler]] = {
    "ddim": DDIM,
    "euler": DDIM,
    "ddpm": DDPM,
    "heun": Heun,
    "dpm++": DPMSolver,
}


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
