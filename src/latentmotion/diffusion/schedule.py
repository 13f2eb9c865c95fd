"""How much signal and how much noise there is at time t: z_t = alpha(t) z_0 + sigma(t) epsilon.

`ScaledLinear` is the paper's (section 3.2; variance preserving, 1,000 discrete times, betas linear
in their square root, as Stable Diffusion's). `LinearPath` is the straight line of flow matching
(Lipman et al. 2023; Liu et al. 2023): alpha = 1 - t, sigma = t.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from array_api_compat import array_namespace, device

from latentmotion.errors import InputError

Time = Any
"""One time as a number, or an array of one time per item of the batch (NumPy or torch)."""


@runtime_checkable
class Schedule(Protocol):
    """The noise schedule; immutable, so that one serves many requests at once."""

    def alpha(self, t: Time) -> Any:
        """Returns the weight of the signal at `t`, in the shape of `t`."""
        ...

    def sigma(self, t: Time) -> Any:
        """Returns the weight of the noise at `t`, in the shape of `t`."""
        ...

    def slope(self, t: Time) -> tuple[Any, Any]:
        """Returns the weights of signal and noise in the velocity at `t`."""
        ...

    def at(self, u: Any) -> Any:
        """Returns the times at the fractions `u` of the schedule, 0 ≤ u < 1: for training."""
        ...

    def times(self, steps: int) -> np.ndarray:
        """Returns `steps` + 1 descending times: where a sampler stops over, its end included."""
        ...


@dataclass(frozen=True)
class ScaledLinear:
    """The paper's schedule of discrete times; time -1 means no noise at all.

    With the defaults the times are those of the authors' DDIM (..., 21, 1, then 0, which keeps a
    hair of noise); `offset=0, ends_clean=True` gives those of their DDPM (..., 1, 0, then -1).
    """

    start: float = 0.00085
    """First beta."""
    end: float = 0.012
    """Last beta."""
    length: int = 1000
    """Number of discrete times."""
    offset: int = 1
    """Added to all times of a sampler."""
    ends_clean: bool = False
    """Whether sampling ends at -1, without noise, instead of at 0."""

    def alpha(self, t: Time) -> Any:
        """Returns sqrt of the cumulative product of 1 - beta."""
        return _look_up(np.sqrt(self._signal), t)

    def sigma(self, t: Time) -> Any:
        """Returns sqrt(1 - alpha²)."""
        return _look_up(np.sqrt(1 - self._signal), t)

    def slope(self, t: Time) -> tuple[Any, Any]:
        """Returns (-sigma, alpha): v = alpha epsilon - sigma z_0 (Salimans & Ho 2022)."""
        return -self.sigma(t), self.alpha(t)

    def at(self, u: Any) -> Any:
        """Returns the discrete times floor(u · length), as floating-point numbers like `u`."""
        return array_namespace(u).floor(u * self.length)

    def times(self, steps: int) -> np.ndarray:
        """Returns times with the spacing that diffusers calls leading."""
        _check_steps(steps, self.length)
        spacing = self.length // steps
        # With a step for every time there is no room for the offset; diffusers fails there.
        offset = min(self.offset, self.length - 1 - (steps - 1) * spacing)
        times = np.arange(steps - 1, -1, -1) * spacing + offset
        return np.append(times, -1 if self.ends_clean else 0).astype(np.float32)

    @cached_property
    def _signal(self) -> np.ndarray:
        beta = np.linspace(self.start**0.5, self.end**0.5, self.length) ** 2
        return np.append(np.cumprod(1 - beta), 1.0)  # entry -1: no noise


@dataclass(frozen=True)
class LinearPath:
    """The straight line from noise (t = 1) to latents (t = 0)."""

    def alpha(self, t: Time) -> Any:
        """Returns 1 - t."""
        return 1 - t

    def sigma(self, t: Time) -> Any:
        """Returns t."""
        return t

    def slope(self, t: Time) -> tuple[Any, Any]:
        """Returns (-1, 1): the velocity dz/dt = epsilon - z_0."""
        return -1.0, 1.0

    def at(self, u: Any) -> Any:
        """Returns `u`."""
        return u

    def times(self, steps: int) -> np.ndarray:
        """Returns equal steps from 1 down to 0."""
        _check_steps(steps, 10_000)
        return np.linspace(1, 0, steps + 1, dtype=np.float32)


def _look_up(table: np.ndarray, t: Time) -> Any:
    if np.ndim(t) == 0:
        return float(table[int(t)])
    xp = array_namespace(t)
    index = xp.astype(t, xp.int64)
    values = xp.asarray(table.astype(np.float32), device=device(t))
    return values[index]


def _check_steps(steps: int, most: int) -> None:
    if not 1 <= steps <= most:
        raise InputError(f"{steps} sampling steps: expected 1 to {most}")
