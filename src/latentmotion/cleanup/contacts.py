"""Foot contacts and stance: when each foot joint stands, and how a foot slides while it does.

A contact begins where a joint is low and slow, and lasts until it is clearly high or fast; short
gaps are closed, contacts of a blink are dropped. Speeds are means over three frames. A joint's
own lowest heights say what low means, as an ankle stands higher than a toe.

The stance of a foot follows the joint that carries the weight, the toe rather than the ankle or
heel. A stance phase begins when the foot has come to rest and ends before it takes off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from latentmotion.kinematics.skeleton import Skeleton

Path = Float[np.ndarray, "frames 3"]
Interval = tuple[int, int]
"""First frame of a contact, and the frame after its last."""

_SLOW = 0.1
"""Meters per second: frames in which a foot is slower say where it stands."""

_ENDS = 0.15
"""Seconds at most by which a contact is shortened at either end."""

_JUMP = (0.02, 0.8)
"""A foot is put elsewhere where it makes this way, meters, and this share of all the way that it
makes in the contact, within the time of a step."""


@dataclass(frozen=True)
class Contacts:
    """What counts as standing. The first of a pair begins a contact, the second ends it."""

    height: tuple[float, float] = (0.04, 0.06)
    """Meters above the joint's standing height."""
    speed: tuple[float, float] = (0.5, 0.75)
    """Horizontal meters per second. Generous: a foot that slides should stand."""
    climb: tuple[float, float] = (0.35, 0.6)
    """Vertical meters per second."""
    shortest: float = 0.1
    """Seconds: contacts that are shorter are none, and gaps that are shorter are closed."""


def foot_contacts(
    joints: Float[np.ndarray, "frames joints 3"],
    fps: float,
    skeleton: Skeleton,
    settings: Contacts = Contacts(),
) -> Bool[np.ndarray, "frames feet"]:
    """Returns for each joint of the left foot, then of the right, whether it stands."""
    feet = joints[:, [*skeleton.left_foot, *skeleton.right_foot]]
    height = feet[..., 1] - _standing_heights(feet, len(skeleton.left_foot))
    velocity = np.gradient(feet, axis=0) * fps if len(feet) > 1 else np.zeros_like(feet)
    across, climb = np.linalg.norm(velocity[..., ::2], axis=-1), np.abs(velocity[..., 1])
    limits = (settings.height, settings.speed, settings.climb)
    begins, lasts = (
        (height < limits[0][n]) & (across < limits[1][n]) & (climb < limits[2][n]) for n in (0, 1)
    )
    contacts = np.zeros_like(lasts)
    for foot in range(lasts.shape[1]):
        for start, end in contact_intervals(lasts[:, foot]):
            contacts[start:end, foot] = begins[start:end, foot].any()
    frames = max(1, round(settings.shortest * fps))
    for column in contacts.T:
        _fill(column, False, frames - 1)
        _fill(column, True, frames - 1)
    return contacts


def contact_intervals(standing: Bool[np.ndarray, " frames"]) -> Iterator[Interval]:
    """Yields first frame and the frame after the last of every contact of one joint."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], standing.astype(np.int8), [0]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _standing_heights(
    feet: Float[np.ndarray, "frames feet 3"], left: int
) -> Float[np.ndarray, " feet"]:
    """Returns how high each joint is while it stands; both sides of a body are alike."""
    low = np.percentile(feet[..., 1], 5, axis=0)
    if 2 * left == len(low):
        low = np.tile(low.reshape(2, left).min(axis=0), 2)
    return np.clip(low, 0, 0.12)


def _fill(standing: Bool[np.ndarray, " frames"], value: bool, longest: int) -> None:
    """Flips stretches of `value` that are short and lie between others, in place."""
    for start, end in list(contact_intervals(standing == value)):
        inside = start > 0 and end < len(standing)
        if end - start <= longest and (inside or value):
            standing[start:end] = not value


@dataclass(frozen=True, eq=False)
class FootStance:
    """One foot over time."""

    path: Path
    """Where the joint that carries the weight is, up to a constant in each contact; y is 0."""
    speed: Float[np.ndarray, " frames"]
    """How fast it slides, meters per second."""
    intervals: tuple[Interval, ...]
    """The stance phases, in order."""

    @property
    def weight(self) -> Float[np.ndarray, " frames"]:
        """How surely the foot stands in each frame, given that it has contact."""
        return 1 / (1 + (self.speed / _SLOW) ** 2)

    def center(self, interval: Interval) -> Float[np.ndarray, " 3"]:
        """Returns the mean of the path over one contact, in which slow frames weigh most."""
        part = slice(*interval)
        return np.average(self.path[part], axis=0, weights=self.weight[part])

    def moved(self, root: Path) -> FootStance:
        """Returns the same foot under a body that is moved by `root`."""
        return replace(self, path=self.path + root)

    def eased(self, rest: tuple[float, float], far: tuple[float, float]) -> FootStance:
        """Returns the same foot, its path kept only as far as it slides in each contact.

        A foot that comes to rest for a quarter of its contact does not slide, whatever it does
        while it lands, rolls and takes off.

        Args:
            rest: Meters per second in that quarter: it rests below the first, slides above the
                second.
            far: Meters, root mean square, that it may get about nevertheless.
        """
        path = self.path.copy()
        for interval in self.intervals:
            part, away = slice(*interval), self.path[slice(*interval)] - self.center(interval)
            about = np.sqrt(np.average((away**2).sum(axis=-1), weights=self.weight[part]))
            slow = np.quantile(self.speed[part], 0.25)
            path[part] = max(float(ramp(slow, *rest)), float(ramp(about, *far))) * away
        return replace(self, path=path)

    def broken_at_jumps(self, pause: int) -> FootStance:
        """Returns the same foot, contacts broken where it is put elsewhere and stands again."""

        def jumps(interval: Interval) -> bool:
            path, first = self.path[slice(*interval)], self._fastest(interval, pause) - interval[0]
            way = np.linalg.norm(path[first + pause] - path[first])
            return bool(way > max(_JUMP[0], _JUMP[1] * np.linalg.norm(np.ptp(path, axis=0))))

        return self._broken(jumps, pause)

    def broken_at_slips(self, slip: float, pause: int) -> FootStance:
        """Returns the same foot, contacts broken in which it gets farther than `slip`, meters."""

        def slips(interval: Interval) -> bool:
            away = self.path[slice(*interval)] - self.center(interval)
            return bool(np.linalg.norm(away, axis=-1).max() > slip)

        return self._broken(slips, pause)

    def _broken(self, cause: Callable[[Interval], bool], pause: int) -> FootStance:
        """Breaks contacts where there is cause, for as many frames as a step takes."""
        kept, left = [], list(self.intervals)
        while left:
            start, end = interval = left.pop()
            if end - start > 3 * pause and cause(interval):
                first = self._fastest(interval, pause)
                left += [(start, first), (first + pause, end)]
            else:
                kept.append(interval)
        return replace(self, intervals=tuple(sorted(kept)))

    def _fastest(self, interval: Interval, pause: int) -> int:
        """Returns where the most way begins that is made in a pause, of equal ones the middle."""
        path = self.path[slice(*interval)]
        way = np.linalg.norm(path[pause:] - path[:-pause], axis=-1)
        middle = np.abs(np.linspace(-1, 1, len(way)))
        inner = slice(pause, len(way) - pause)
        return interval[0] + pause + int((way * (1 - 0.2 * middle))[inner].argmax())


def foot_stance(
    pivots: Float[np.ndarray, "frames pivots 3"],
    standing: Bool[np.ndarray, "frames pivots"],
    fps: float,
    landing: float,
) -> FootStance:
    """Returns the stance of a foot: how the joint that carries the weight slides, and when.

    Args:
        pivots: Its joints that touch the floor, the one that holds longest last.
        standing: Whether they do.
        fps: Frames per second.
        landing: Meters per second above which a foot that comes down or takes off does not stand.
    """
    # The joint that carries the weight: one that stands before one that lands, toe before ankle.
    steps = np.diff(pivots, axis=0) * (1, 0, 1)
    holds = np.where(standing[1:] & standing[:-1], 2, standing[1:] | standing[:-1])
    rank = holds * len(pivots[0]) + np.arange(len(pivots[0]))
    slides = np.take_along_axis(steps, rank.argmax(axis=1)[:, None, None], axis=1)[:, 0]
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(slides, axis=0)])
    speed = np.zeros(len(path))
    if len(path) > 1:
        speed = np.linalg.norm(np.gradient(path, axis=0), axis=-1) * fps
    most = round(_ENDS * fps)
    contacts = contact_intervals(np.logical_or.reduce(standing, axis=1))
    found = [_without_fast_ends(speed, contact, landing, most) for contact in contacts]
    return FootStance(path, speed, tuple((a, b) for a, b in found if b - a > 1))


def ramp(values: ArrayLike, low: float, high: float) -> np.ndarray:
    """Returns 0 below `low`, 1 above `high`, and a smooth step between."""
    u = np.clip((np.asarray(values) - low) / (high - low), 0, 1)
    return np.asarray(u * u * (3 - 2 * u))


def _without_fast_ends(
    speed: Float[np.ndarray, " frames"], interval: Interval, landing: float, most: int
) -> Interval:
    """Returns a contact without its fast ends; where the motion begins or stops it has none."""
    start, end = interval
    first, last = interval
    while start > 0 and first < min(start + most, end) and speed[first] > landing:
        first += 1
    while end < len(speed) and last > max(end - most, first) and speed[last - 1] > landing:
        last -= 1
    return first, last
