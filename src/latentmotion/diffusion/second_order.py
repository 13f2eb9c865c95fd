"""Samplers whose error falls with the square of the step: Heun's method and DPM-Solver++(2M)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from jaxtyping import Float

from latentmotion.diffusion.interface import ModelOutput, Noise
from latentmotion.diffusion.parametrization import Parametrization
from latentmotion.diffusion.schedule import Schedule

Latents = Float[Any, "batch tokens width"]


@dataclass(frozen=True)
class Heun:
    """The trapezoid rule for the flow dz = z_0 dα + epsilon dσ: two passes of the denoiser a step.

    Where a step ends without noise, where a network is not asked, it is Euler's (Karras et al.
    2022): a single step of that kind does not change the order.
    """

    schedule: Schedule
    parametrization: Parametrization

    def integrate(
        self, model_output: ModelOutput, z: Latents, times: Sequence[float], noise: Noise
    ) -> Latents:
        """Returns the latents at the last of the times."""
        for t, s in pairwise(times):
            z = self._step(model_output, z, t, s)
        return z

    def _step(self, model_output: ModelOutput, z: Latents, t: float, s: float) -> Latents:
        alpha, sigma = self.schedule.alpha(s), self.schedule.sigma(s)
        z0, epsilon = self.parametrization.to_x0_eps(model_output(z, t), z, t, self.schedule)
        guess = alpha * z0 + sigma * epsilon
        if sigma == 0:
            return guess
        later = self.parametrization.to_x0_eps(model_output(guess, s), guess, s, self.schedule)
        rise, fall = alpha - self.schedule.alpha(t), sigma - self.schedule.sigma(t)
        return z + rise * (z0 + later[0]) / 2 + fall * (epsilon + later[1]) / 2


@dataclass(frozen=True)
class DPMSolver:
    """DPM-Solver++(2M) (Lu et al. 2022, algorithm 2): one pass a step, and the last output.

    With λ = log(α / σ) and h = λ_s - λ_t, z_0 is taken to go on as from the step before, of h':
    z_s = (σ_s / σ_t) z_t + α_s (1 - exp(-h)) (z_0 + h / (2 h') (z_0 - z_0')).
    Where h or h' is infinite, at an end without noise or without signal, z_0 alone is used.
    """

    schedule: Schedule
    parametrization: Parametrization

    def integrate(
        self, model_output: ModelOutput, z: Latents, times: Sequence[float], noise: Noise
    ) -> Latents:
        """Returns the latents at the last of the times."""
        before, last = None, 0.0
        for t, s in pairwise(times):
            z0, _ = self.parametrization.to_x0_eps(model_output(z, t), z, t, self.schedule)
            size = self._lambda(s) - self._lambda(t) if s != t else 0.0
            usable = before is not None and last > 0 and math.isfinite(last * size)
            ahead = z0 + size / (2 * last) * (z0 - before) if usable else z0
            z = self._step(ahead, z, t, s)
            before, last = z0, size
        return z

    def _step(self, z0: Latents, z: Latents, t: float, s: float) -> Latents:
        kept = self.schedule.sigma(s) / self.schedule.sigma(t)
        return kept * z + (self.schedule.alpha(s) - self.schedule.alpha(t) * kept) * z0

    def _lambda(self, t: float) -> float:
        alpha, sigma = self.schedule.alpha(t), self.schedule.sigma(t)
        if alpha == 0 or sigma == 0:
            return -math.inf if alpha == 0 else math.inf
        return math.log(alpha / sigma)
