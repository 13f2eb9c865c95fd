"""How much signal and noise there is at time t, and the few times of a distilled denoiser.

`ScaledLinear` is the paper's (section 3.2; variance preserving, 1,000 discrete times, betas linear
in their square root, as Stable Diffusion's). `Cosine` is MDM's (Nichol & Dhariwal 2021): the signal
falls like a squared cosine. `LinearPath` is the straight line of flow matching
(Lipman et al. 2023; Liu et al. 2023): alpha = 1 - t, sigma = t.

A student gets the guidance scale w and the step size, 1 / steps, as inputs, so that one evaluation
is a whole step of the guided teacher; its steps begin and end at timesteps of the teacher's solver.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from latentmotion.arrays import array_namespace, device
from latentmotion.errors import InputError
from latentmotion.storage.configuration import part_named
from latentmotion.storage.limits import MOST_STEPS

Time = Any  # One time as a number, or an array of one time per item of the batch (NumPy or torch).


@runtime_checkable
class Schedule(Protocol):
    """The noise schedule; immutable, so that one serves many requests at once."""

    def alpha(self, t: Time) -> Any:
        """Returns the weight of the signal at `t`, in the shape of `t`."""
        ...

    def sigma(self, t: Time) -> Any:
        """Returns the weight of the noise at `t`, in the shape of `t`."""
        ...

    def velocity_coefficients(self, t: Time) -> tuple[Any, Any]:
        """Returns the weights of signal and noise in the velocity at `t`."""
        ...

    def time_at(self, u: Any) -> Any:
        """Returns the times at the fractions `u` of the schedule, 0 ≤ u < 1: for training."""
        ...

    def timesteps(self, steps: int) -> np.ndarray:
        """Returns the `steps` + 1 descending times of a sampler's steps, the end included."""
        ...


class DiscreteTimes(ABC):
    """Variance preserving, at the times 0, 1, …; time -1 means no noise at all.

    signal(t) = alpha² = product of 1 - beta up to t, sigma² = 1 - alpha².
    """

    length: int  # Number of discrete times.

    def __post_init__(self) -> None:
        if not 1 <= self.length <= MOST_STEPS:
            raise InputError(f"schedule.length {self.length:,}: expected 1 to {MOST_STEPS:,}")

    @abstractmethod
    def betas(self) -> Float[np.ndarray, " times"]:
        """Returns the share of the signal that each time loses."""

    @cached_property
    def signal(self) -> Float[np.ndarray, " times_and_one"]:
        """The signal at every time, and 1 as the last entry: time -1 has no noise."""
        return np.append(np.cumprod(1 - self.betas()), 1.0)

    def time_at(self, u: Any) -> Any:
        """Returns the discrete times floor(u · length), as floating-point numbers like `u`."""
        return array_namespace(u).floor(u * self.length)

    def leading(self, steps: int) -> Int[np.ndarray, " steps"]:
        """Returns times with the spacing that diffusers calls leading."""
        _check_steps(steps, self.length)
        return np.arange(steps - 1, -1, -1) * (self.length // steps)

    def alpha(self, t: Time) -> Any:
        """Returns sqrt of the signal."""
        return _look_up(np.sqrt(self.signal), t)

    def sigma(self, t: Time) -> Any:
        """Returns sqrt(1 - alpha²)."""
        return _look_up(np.sqrt(1 - self.signal), t)

    def velocity_coefficients(self, t: Time) -> tuple[Any, Any]:
        """Returns (-sigma, alpha): v = alpha epsilon - sigma z_0 (Salimans & Ho 2022)."""
        return -self.sigma(t), self.alpha(t)


@dataclass(frozen=True)
class ScaledLinear(DiscreteTimes):
    """The paper's schedule.

    With the defaults the times are those of the authors' DDIM (..., 21, 1, then 0, which keeps a
    hair of noise); `offset=0, ends_clean=True` gives those of their DDPM (..., 1, 0, then -1).
    """

    start: float = 0.00085  # First beta.
    end: float = 0.012  # Last beta.
    length: int = 1000  # Number of discrete times.
    offset: int = 1  # Added to all times of a sampler.
    ends_clean: bool = False  # Whether sampling ends at -1, without noise, instead of at 0.

    def timesteps(self, steps: int) -> np.ndarray:
        """Returns leading times with an offset."""
        # With a step for every time there is no room for the offset; diffusers fails there.
        times = self.leading(steps)
        offset = min(self.offset, self.length - 1 - int(times[0]))
        return np.append(times + offset, -1 if self.ends_clean else 0).astype(np.float32)

    def betas(self) -> Float[np.ndarray, " times"]:
        """Returns betas whose square root rises linearly."""
        return np.linspace(self.start**0.5, self.end**0.5, self.length) ** 2


@dataclass(frozen=True)
class Cosine(DiscreteTimes):
    """The schedule of MDM; sampling ends without noise.

    beta(t) = 1 - f(t + 1) / f(t) ≤ 0.999 with f(t) = cos²(π/2 · (t / length + 0.008) / 1.008).
    """

    # Number of discrete times: 1,000, or 50 in MDM's fast form, which is trained with so few.
    length: int = 1000

    def timesteps(self, steps: int) -> np.ndarray:
        """Returns leading times, then -1."""
        return np.append(self.leading(steps), -1).astype(np.float32)

    def betas(self) -> Float[np.ndarray, " times"]:
        """Returns the betas that leave f as the signal."""
        fractions = np.arange(self.length + 1) / self.length
        # Nichol & Dhariwal 2021, eq. 17: s = 0.008 keeps the first step from being too small, and
        # betas are clipped at 0.999 near the end.
        f = np.cos(np.pi / 2 * (fractions + 0.008) / 1.008) ** 2
        return np.minimum(1 - f[1:] / f[:-1], 0.999)


@dataclass(frozen=True)
class LinearPath:
    """The straight line from noise (t = 1) to latents (t = 0)."""

    def alpha(self, t: Time) -> Any:
        """Returns 1 - t."""
        return 1 - t

    def sigma(self, t: Time) -> Any:
        """Returns t."""
        return t

    def velocity_coefficients(self, t: Time) -> tuple[Any, Any]:
        """Returns (-1, 1): the velocity dz/dt = epsilon - z_0."""
        return -1.0, 1.0

    def time_at(self, u: Any) -> Any:
        """Returns `u`."""
        return u

    def timesteps(self, steps: int) -> np.ndarray:
        """Returns equal steps from 1 down to 0."""
        _check_steps(steps, 10_000)
        return np.linspace(1, 0, steps + 1, dtype=np.float32)


class _Wrapped:
    """A schedule with the weights and times of another."""

    schedule: Any  # The other, a `Schedule`.

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


@dataclass(frozen=True)
class PluginSchedule(_Wrapped):
    """A schedule that another package adds, under `latentmotion.schedules`."""

    plugin: str  # Name of its entry point.
    settings: dict[str, Any] = field(default_factory=dict)  # Keyword arguments of it.

    @cached_property
    def schedule(self) -> Schedule:
        """The schedule itself."""
        return part_named("latentmotion.schedules", self.plugin)(**self.settings)

    def timesteps(self, steps: int) -> np.ndarray:
        """Returns `steps` + 1 descending times."""
        return self.schedule.timesteps(steps)


# Every schedule that a card or an experiment can name.
AnySchedule = ScaledLinear | Cosine | LinearPath | PluginSchedule


def _look_up(table: np.ndarray, t: Time) -> Any:
    if np.ndim(t) == 0:
        return float(table[int(t)])
    xp = array_namespace(t)
    index = xp.astype(t, xp.int64)
    return xp.asarray(table.astype(np.float32), device=device(t))[index]


def _check_steps(steps: int, most: int) -> None:
    if not 1 <= steps <= most:
        raise InputError(f"{steps} sampling steps: expected 1 to {most}")


@dataclass(frozen=True)
class StepCondition:
    """The inputs of a few-step student that other denoisers lack."""

    guidance: Float[Any, " batch"]  # Guidance scale.
    # Length of the step, 1 / steps; 1 goes from noise to latents at once.
    step_size: Float[Any, " batch"]


@dataclass(frozen=True)
class FewStepSchedule(_Wrapped):
    """A schedule whose timesteps are some of the teacher's solver's."""

    schedule: Schedule
    solver_steps: int

    def timesteps(self, steps: int) -> np.ndarray:
        """Returns `steps` + 1 descending timesteps of the solver."""
        return self.schedule.timesteps(self.solver_steps)[:: self.solver_steps // steps]
