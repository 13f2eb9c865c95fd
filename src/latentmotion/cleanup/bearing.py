"""How a foot bears the body: along which path it slides, in which contacts, and how surely.

The path is that of the joint that stands, the toe rather than the ankle or heel. A contact begins
when the foot has come to rest and ends before it takes off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from latentmotion.cleanup.contacts import spans

Path = Float[np.ndarray, "frames 3"]
Period = tuple[int, int]
"""First frame of a contact, and the frame after its last."""

_SLOW = 0.1
"""Meters per second: frames in which a foot is slower say where it stands."""

_ENDS = 0.15
"""Seconds at most by which a contact is shortened at either end."""

_JUMP = (0.02, 0.8)
"""A foot is put elsewhere where it makes this way, meters, and this share of all the way that it
makes in the contact, within the time of a step."""


@dataclass(frozen=True, eq=False)
class Bearing:
    """One foot over time."""

    path: Path
    """Where the joint that bears is, up to a constant in each contact; y is 0."""
    speed: Float[np.ndarray, " frames"]
    """How fast it slides, meters per second."""
    periods: tuple[Period, ...]
    """The contacts, in order."""

    @property
    def weight(self) -> Float[np.ndarray, " frames"]:
        """How surely the foot stands in each frame, given that it has contact."""
        return 1 / (1 + (self.speed / _SLOW) ** 2)

    def center(self, period: Period) -> Float[np.ndarray, " 3"]:
        """Returns the mean of the path over one contact, in which slow frames weigh most."""
        part = slice(*period)
        return np.average(self.path[part], axis=0, weights=self.weight[part])

    def moved(self, root: Path) -> Bearing:
        """Returns the same foot under a body that is moved by `root`."""
        return replace(self, path=self.path + root)

    def eased(self, rest: tuple[float, float], far: tuple[float, float]) -> Bearing:
        """Returns the same foot, its path kept only as far as it slides in each contact.

        A foot that comes to rest for a quarter of its contact does not slide, whatever it does
        while it lands, rolls and takes off.

        Args:
            rest: Meters per second in that quarter: it rests below the first, slides above the
                second.
            far: Meters, root mean square, that it may get about nevertheless.
        """
        path = self.path.copy()
        for period in self.periods:
            part, away = slice(*period), self.path[slice(*period)] - self.center(period)
            about = np.sqrt(np.average((away**2).sum(axis=-1), weights=self.weight[part]))
            slow = np.quantile(self.speed[part], 0.25)
            path[part] = max(float(ramp(slow, *rest)), float(ramp(about, *far))) * away
        return replace(self, path=path)

    def broken_at_jumps(self, pause: int) -> Bearing:
        """Returns the same foot, contacts broken where it is put elsewhere and stands again."""

        def jumps(period: Period) -> bool:
            path, first = self.path[slice(*period)], self._fastest(period, pause) - period[0]
            way = np.linalg.norm(path[first + pause] - path[first])
            return bool(way > max(_JUMP[0], _JUMP[1] * np.linalg.norm(np.ptp(path, axis=0))))

        return self._broken(jumps, pause)

    def broken_at_slips(self, slip: float, pause: int) -> Bearing:
        """Returns the same foot, contacts broken in which it gets farther than `slip`, meters."""

        def slips(period: Period) -> bool:
            away = self.path[slice(*period)] - self.center(period)
            return bool(np.linalg.norm(away, axis=-1).max() > slip)

        return self._broken(slips, pause)

    def _broken(self, cause: Callable[[Period], bool], pause: int) -> Bearing:
        """Breaks contacts where there is cause, for as many frames as a step takes."""
        kept, left = [], list(self.periods)
        while left:
            start, end = period = left.pop()
            if end - start > 3 * pause and cause(period):
                first = self._fastest(period, pause)
                left += [(start, first), (first + pause, end)]
            else:
                kept.append(period)
        return replace(self, periods=tuple(sorted(kept)))

    def _fastest(self, period: Period, pause: int) -> int:
        """Returns where the most way begins that is made in a pause, of equal ones the middle."""
        path = self.path[slice(*period)]
        way = np.linalg.norm(path[pause:] - path[:-pause], axis=-1)
        middle = np.abs(np.linspace(-1, 1, len(way)))
        inner = slice(pause, len(way) - pause)
        return period[0] + pause + int((way * (1 - 0.2 * middle))[inner].argmax())


def bearing(
    pivots: Float[np.ndarray, "frames pivots 3"],
    standing: Bool[np.ndarray, "frames pivots"],
    fps: float,
    landing: float,
) -> Bearing:
    """Returns how a foot bears.

    Args:
        pivots: Its joints that touch the floor, the one that holds longest last.
        standing: Whether they do.
        fps: Frames per second.
        landing: Meters per second at which a foot that comes down or takes off bears not yet.
    """
    slides = _slides(pivots, standing)
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(slides, axis=0)])
    speed = np.zeros(len(path))
    if len(path) > 1:
        speed = np.linalg.norm(np.gradient(path, axis=0), axis=-1) * fps
    most = round(_ENDS * fps)
    found = [
        _at_rest(speed, p, landing, most) for p in spans(np.logical_or.reduce(standing, axis=1))
    ]
    return Bearing(path, speed, tuple((a, b) for a, b in found if b - a > 1))


def ramp(values: ArrayLike, low: float, high: float) -> np.ndarray:
    """Returns 0 below `low`, 1 above `high`, and a smooth step between."""
    u = np.clip((np.asarray(values) - low) / (high - low), 0, 1)
    return np.asarray(u * u * (3 - 2 * u))


def _slides(
    pivots: Float[np.ndarray, "frames pivots 3"], standing: Bool[np.ndarray, "frames pivots"]
) -> Float[np.ndarray, "steps 3"]:
    """Returns the horizontal step of the joint that bears the foot, toe before ankle."""
    steps = np.diff(pivots, axis=0) * (1, 0, 1)
    holds = np.where(standing[1:] & standing[:-1], 2, standing[1:] | standing[:-1])
    rank = holds * len(pivots[0]) + np.arange(len(pivots[0]))
    return np.take_along_axis(steps, rank.argmax(axis=1)[:, None, None], axis=1)[:, 0]


def _at_rest(
    speed: Float[np.ndarray, " frames"], period: Period, landing: float, most: int
) -> Period:
    """Returns a contact without its fast ends; where the motion begins or stops it has none."""
    start, end = period
    first, last = period
    while start > 0 and first < min(start + most, end) and speed[first] > landing:
        first += 1
    while end < len(speed) and last > max(end - most, first) and speed[last - 1] > landing:
        last -= 1
    return first, last
