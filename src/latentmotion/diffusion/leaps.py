"""Few long steps for many short ones: what a distilled denoiser is told, and may be asked for.

A student of few steps knows the guidance scale w and its stride, 1 / steps, as inputs, so that one
pass is a whole leap of the guided teacher; leaps begin and end at times of the teacher's solver.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.diffusion.schedule import Schedule, Time
from latentmotion.errors import InputError


@dataclass(frozen=True)
class Leap:
    """What a student is told of the leap that it shall make."""

    guidance: Float[Any, " batch"]
    """Guidance scale."""
    stride: Float[Any, " batch"]
    """Share of the way from noise to latents, 1 / steps."""


@dataclass(frozen=True)
class Leaps:
    """Which leaps a student knows.

    Raises:
        InputError: A number of steps does not divide that of the solver, or there is no range.
    """

    guidance: tuple[float, float] = (1.0, 6.0)
    """Smallest and largest guidance scale."""
    steps: tuple[int, ...] = (1, 2, 4)
    """Numbers of steps in which it can go the whole way."""
    of: int = 16
    """Steps of the teacher's solver, which all of these divide."""

    def __post_init__(self) -> None:
        odd = [count for count in self.steps if count < 1 or self.of % count]
        if odd or not self.steps:
            found = odd[0] if odd else "none"
            raise InputError(f"leaps.steps: {found}; expected divisors of leaps.of, {self.of}")
        if not 0 <= self.guidance[0] <= self.guidance[1]:
            raise InputError(f"leaps.guidance {self.guidance}: expected the smaller scale first")

    def check(self, steps: int, guidance: float, sampler: str) -> None:
        """Raises InputError where a student is asked for what it has not learned."""
        least, most = self.guidance
        if steps not in self.steps:
            known = ", ".join(map(str, self.steps))
            raise InputError(f"{steps} sampling steps: this distilled model takes {known}")
        if not least <= guidance <= most:
            raise InputError(
                f"guidance {guidance:g}: this distilled model learned {least:g} to {most:g}"
            )
        if sampler not in ("ddim", "euler"):
            raise InputError(f"sampler {sampler}: a distilled model takes leaps of ddim alone")

    @property
    def stops(self) -> list[int]:
        """The solver's times at which some leap begins or ends, by number."""
        return sorted({n * self.of // count for count in self.steps for n in range(count + 1)})


@dataclass(frozen=True)
class LeapTimes:
    """A schedule whose times are some of the teacher's solver's."""

    schedule: Schedule
    leaps: Leaps

    def times(self, steps: int) -> np.ndarray:
        """Returns `steps` + 1 descending times of the solver."""
        return self.schedule.times(self.leaps.of)[:: self.leaps.of // steps]

    def alpha(self, t: Time) -> Any:
        """Returns the weight of the signal at `t`."""
        return self.schedule.alpha(t)

    def sigma(self, t: Time) -> Any:
        """Returns the weight of the noise at `t`."""
        return self.schedule.sigma(t)

    def slope(self, t: Time) -> tuple[Any, Any]:
        """Returns the weights of signal and noise in the velocity at `t`."""
        return self.schedule.slope(t)

    def at(self, u: Any) -> Any:
        """Returns the times at the fractions `u` of the schedule."""
        return self.schedule.at(u)
