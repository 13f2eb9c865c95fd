"""Few-step models: which step sizes and guidance scales a distilled denoiser has learned.

A student gets the guidance scale w and the step size, 1 / steps, as inputs, so that one evaluation
is a whole step of the guided teacher; its steps begin and end at timesteps of the teacher's solver.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.diffusion.schedule import Schedule, Time
from latentmotion.errors import InputError
from latentmotion.storage.limits import MOST_STEPS


@dataclass(frozen=True)
class StepCondition:
    """The inputs of a few-step student that other denoisers lack."""

    guidance: Float[Any, " batch"]
    """Guidance scale."""
    step_size: Float[Any, " batch"]
    """Length of the step, 1 / steps; 1 goes from noise to latents at once."""


@dataclass(frozen=True)
class FewStepConfig:
    """The step counts and guidance scales that a student learns.

    Raises:
        InputError: A number of steps does not divide that of the solver, or there is no range.
    """

    guidance: tuple[float, float] = (1.0, 6.0)
    """Smallest and largest guidance scale."""
    steps: tuple[int, ...] = (1, 2, 4)
    """Numbers of steps in which it can be sampled."""
    solver_steps: int = 16
    """Steps of the teacher's solver, which all of these divide."""

    def __post_init__(self) -> None:
        if not 1 <= self.solver_steps <= MOST_STEPS or len(self.steps) > self.solver_steps:
            raise InputError(
                f"few_step.solver_steps {self.solver_steps}: expected 1 to {MOST_STEPS:,}"
            )
        odd = [count for count in self.steps if count < 1 or self.solver_steps % count]
        if odd or not self.steps:
            found = odd[0] if odd else "none"
            raise InputError(
                f"few_step.steps: {found}; expected divisors of few_step.solver_steps, "
                f"{self.solver_steps}"
            )
        if not 0 <= self.guidance[0] <= self.guidance[1]:
            raise InputError(f"few_step.guidance {self.guidance}: expected the smaller scale first")

    def check(self, steps: int, guidance: float, sampler: str) -> None:
        """Raises InputError for sampling settings that the student has not learned."""
        smallest, largest = self.guidance
        if steps not in self.steps:
            known = ", ".join(map(str, self.steps))
            raise InputError(f"{steps} sampling steps: this distilled model takes {known}")
        if not smallest <= guidance <= largest:
            raise InputError(
                f"guidance {guidance:g}: this distilled model learned {smallest:g} to {largest:g}"
            )
        if sampler not in ("ddim", "euler"):
            raise InputError(f"sampler {sampler}: a distilled model is sampled with ddim alone")

    @property
    def stops(self) -> list[int]:
        """Numbers of the solver's timesteps at which some step begins or ends."""
        counts = self.steps
        return sorted(
            {n * self.solver_steps // count for count in counts for n in range(count + 1)}
        )


@dataclass(frozen=True)
class FewStepSchedule:
    """A schedule whose timesteps are some of the teacher's solver's."""

    schedule: Schedule
    few_step: FewStepConfig

    def timesteps(self, steps: int) -> np.ndarray:
        """Returns `steps` + 1 descending timesteps of the solver."""
        solver_steps = self.few_step.solver_steps
        return self.schedule.timesteps(solver_steps)[:: solver_steps // steps]

    def alpha(self, t: Time) -> Any:
        """Returns the weight of the signal at `t`."""
        return self.schedule.alpha(t)

    def sigma(self, t: Time) -> Any:
        """Returns the weight of the noise at `t`."""
        return self.schedule.sigma(t)

    def velocity_coefficients(self, t: Time) -> tuple[Any, Any]:
        """Returns the weights of signal and noise in the velocity at `t`."""
        return self.schedule.velocity_coefficients(t)

    def time_at(self, u: Any) -> Any:
        """Returns the times at the fractions `u` of the schedule."""
        return self.schedule.time_at(u)
