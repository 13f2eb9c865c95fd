"""Samplers: solvers that integrate from noise to latents, in steps from time t to an earlier s.

Each step can be seen (`trajectory`), and `sample` returns the last. A sampler knows the schedule
alone. What the network's output means is its estimator's business, and guidance is a denoiser
around a denoiser. Of `Heun` and `DPMSolver` the error falls with the square of the step.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.parametrization import (
    Estimate,
    Estimates,
    Estimator,
    Latents,
    Mask,
    Noise,
)
from latentmotion.diffusion.schedule import ScaledLinear, Schedule
from latentmotion.errors import InputError
from latentmotion.plugins import plugin_names
from latentmotion.storage.configuration import part_named

# Samplers that cards and the command line name; `euler` is `ddim`, see there.
SamplerName = Literal["ddim", "euler", "ddpm", "heun", "dpm++"]


@runtime_checkable
class Sampler(Protocol):
    """A solver that leads from noise to latents."""

    @property
    def schedule(self) -> Schedule:
        """The noise schedule, which gives alpha and sigma at each time."""
        ...

    def steps(
        self, estimate: Estimate, z: Latents, times: Sequence[float], noise: Noise
    ) -> Iterator[Latents]:
        """Yields the latents at each of the descending `times` after the first; mutates nothing.

        Args:
            estimate: Returns the estimates of (z_0, epsilon), given latents and one time for all.
            z: Latents at the first of the times.
            times: Descending times between which it steps.
            noise: Draws fresh noise, for samplers that add some.
        """
        ...


class SingleStepSampler(ABC):
    """A sampler with one network evaluation per step, each step independent of earlier ones."""

    @abstractmethod
    def step(self, estimates: Estimates, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns z_s, s < t, from z_t and the estimates of (z_0, epsilon) there; mutates none."""

    def steps(
        self, estimate: Estimate, z: Latents, times: Sequence[float], noise: Noise
    ) -> Iterator[Latents]:
        """Yields the latents after each step."""
        for t, s in pairwise(times):
            z = self.step(estimate(z, t), z, t, s, noise)
            yield z


@dataclass(frozen=True)
class DDIM(SingleStepSampler):
    """Song et al. 2021, eq. 12 with its eta 0: keep the estimated noise.

    That is Euler's method on every schedule: the flow is dz = z_0 dα + epsilon dσ, and
    z_t + (α_s - α_t) z_0 + (σ_s - σ_t) epsilon = α_s z_0 + σ_s epsilon, as z_t = α_t z_0 + σ_t
    epsilon.
    """

    schedule: Schedule

    def step(self, estimates: Estimates, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns alpha_s z_0 + sigma_s epsilon."""
        z0, epsilon = estimates
        return self.schedule.alpha(s) * z0 + self.schedule.sigma(s) * epsilon


@dataclass(frozen=True)
class DDPM(SingleStepSampler):
    """Ho et al. 2020, eq. 6-7: draw from q(z_s | z_t, z_0), with its own variance (fixed small).

    With a = alpha_t / alpha_s and b² = sigma_t² - a² sigma_s², the noise added between s and t:
    mean = (a sigma_s² z_t + alpha_s b² z_0) / sigma_t², deviation = b sigma_s / sigma_t.
    """

    schedule: Schedule

    def step(self, estimates: Estimates, z: Latents, t: float, s: float, noise: Noise) -> Latents:
        """Returns a draw from the posterior at `s`; at an end without noise, its mean."""
        (z0, _), schedule = estimates, self.schedule
        sigma_t, sigma_s = schedule.sigma(t), schedule.sigma(s)
        a = schedule.alpha(t) / schedule.alpha(s)
        added = max(sigma_t**2 - (a * sigma_s) ** 2, 0.0)
        of_z, of_z0 = a * (sigma_s / sigma_t) ** 2, schedule.alpha(s) * added / sigma_t**2
        mean, deviation = of_z * z + of_z0 * z0, added**0.5 * sigma_s / sigma_t
        if deviation <= 0:
            return mean
        xp, drawn = array_namespace(z), noise(tuple(z.shape))
        return mean + deviation * xp.asarray(drawn, dtype=z.dtype, device=device(z))


@dataclass(frozen=True)
class Heun:
    """The trapezoid rule for the flow dz = z_0 dα + epsilon dσ: two passes of the denoiser a step.

    Where a step ends without noise, where a network is not asked, it is Euler's (Karras et al.
    2022): a single step of that kind does not change the order.
    """

    schedule: Schedule

    def steps(
        self, estimate: Estimate, z: Latents, times: Sequence[float], noise: Noise
    ) -> Iterator[Latents]:
        """Yields the latents after each step."""
        for t, s in pairwise(times):
            alpha, sigma = self.schedule.alpha(s), self.schedule.sigma(s)
            z0, epsilon = estimate(z, t)
            guess = alpha * z0 + sigma * epsilon
            if sigma != 0:
                later = estimate(guess, s)
                rise, fall = alpha - self.schedule.alpha(t), sigma - self.schedule.sigma(t)
                guess = z + rise * (z0 + later[0]) / 2 + fall * (epsilon + later[1]) / 2
            z = guess
            yield z


@dataclass(frozen=True)
class DPMSolver:
    """DPM-Solver++(2M) (Lu et al. 2022, algorithm 2): one pass a step, and the last estimate.

    With λ = log(α / σ) and h = λ_s - λ_t, z_0 is taken to go on as from the step before, of h':
    z_s = (σ_s / σ_t) z_t + α_s (1 - exp(-h)) (z_0 + h / (2 h') (z_0 - z_0')).
    Where h or h' is infinite, at an end without noise or without signal, z_0 alone is used.
    """

    schedule: Schedule

    def steps(
        self, estimate: Estimate, z: Latents, times: Sequence[float], noise: Noise
    ) -> Iterator[Latents]:
        """Yields the latents after each step."""
        before, last = None, 0.0
        for t, s in pairwise(times):
            z0, _ = estimate(z, t)
            size = self._lambda(s) - self._lambda(t) if s != t else 0.0
            usable = before is not None and last > 0 and math.isfinite(last * size)
            ahead = z0 + size / (2 * last) * (z0 - before) if usable else z0
            ratio = self.schedule.sigma(s) / self.schedule.sigma(t)
            z = ratio * z + (self.schedule.alpha(s) - self.schedule.alpha(t) * ratio) * ahead
            before, last = z0, size
            yield z

    def _lambda(self, t: float) -> float:
        alpha, sigma = self.schedule.alpha(t), self.schedule.sigma(t)
        if alpha == 0 or sigma == 0:
            return -math.inf if alpha == 0 else math.inf
        return math.log(alpha / sigma)


def sampler_named(name: str, schedule: Schedule) -> Sampler:
    """Returns a sampler, of this package or of another under `latentmotion.samplers`.

    DDPM walks the paper's schedule to its very end, as the authors' does.

    Raises:
        InputError: There is none of that name.
    """
    if name not in _SAMPLERS:
        names = *_SAMPLERS, *plugin_names("latentmotion.samplers")
        if name not in names:
            raise InputError(f"unknown sampler {name!r}; known are {', '.join(names)}")
        return part_named("latentmotion.samplers", name)(schedule)
    if name == "ddpm" and isinstance(schedule, ScaledLinear):
        schedule = replace(schedule, offset=0, ends_clean=True)
    return _SAMPLERS[name](schedule)


def sample(
    estimator: Estimator,
    sampler: Sampler,
    z: Latents,
    condition: Conditioning,
    mask: Mask,
    steps: int,
    noise: Noise,
    remaining: int | None = None,
) -> Latents:
    """Returns the latents at the end of the steps; see `trajectory` for the arguments."""
    for _, latents in trajectory(estimator, sampler, z, condition, mask, steps, noise, remaining):
        z = latents
    return z


def trajectory(
    estimator: Estimator,
    sampler: Sampler,
    z: Latents,
    condition: Conditioning,
    mask: Mask,
    steps: int,
    noise: Noise,
    remaining: int | None = None,
) -> Iterator[tuple[float, Latents]]:
    """Yields the latents from pure noise, or noised latents, to clean ones, with their timesteps.

    Args:
        estimator: A denoiser, with guidance around it, that returns estimates of (z_0, epsilon).
        sampler: The rule for one step.
        z: Standard normal noise; with `remaining` steps, latents noised to where these begin.
        condition: Condition of the motion.
        mask: True on real tokens.
        steps: Number of steps from pure noise.
        noise: Draws further noise, where the sampler wants any.
        remaining: Number of steps that are left; by default all.
    """

    def estimate(z: Latents, t: float) -> Estimates:
        return estimator(z, t, condition, mask)

    times = remaining_times(sampler.schedule, steps, remaining)
    yield times[0], z
    yield from zip(times[1:], sampler.steps(estimate, z, times, noise), strict=True)


def remaining_times(schedule: Schedule, steps: int, remaining: int | None) -> list[float]:
    """Returns the descending times of the last `remaining` of so many steps, by default of all."""
    times = schedule.timesteps(steps).tolist()
    return times if remaining is None else times[-remaining - 1 :]


_SAMPLERS: dict[str, Callable[[Schedule], Sampler]] = {
    "ddim": DDIM,
    "euler": DDIM,
    "ddpm": DDPM,
    "heun": Heun,
    "dpm++": DPMSolver,
}


class SeededNoise:
    """Standard normal numbers, each row of a batch from a generator of its own.

    Args:
        seeds: One per row.
        tokens: Number of real tokens of each row; the others are zero. By default all are real.
            So a row gets the same numbers whatever it is padded to.
    """

    def __init__(self, seeds: Sequence[int], tokens: Sequence[int] | None = None) -> None:
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._tokens = tokens

    def __call__(self, shape: tuple[int, ...]) -> Float[np.ndarray, "batch tokens width"]:
        """Returns the next numbers of every row; `shape` is (batch, tokens, width)."""
        noise = np.zeros(shape, np.float32)
        tokens = [shape[1]] * shape[0] if self._tokens is None else self._tokens
        for row, generator, count in zip(noise, self._generators, tokens, strict=True):
            row[:count] = generator.standard_normal((count, *shape[2:]), dtype=np.float32)
        return noise
