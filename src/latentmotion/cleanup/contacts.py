"""Foot contacts and stance: when each foot joint stands, and how a foot slides while it does.

A contact begins where a joint is low and slow, and lasts until it is clearly high or fast; short
gaps are closed, very short contacts dropped. Speeds are means over three frames. Heights are
measured from the joint's own lowest ones, since an ankle stands higher than a toe.

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
"""Meters per second: frames in which a foot is slower count most for where it stands."""

_ENDS = 0.15
"""Seconds at most by which a contact is shortened at either end."""

_JUMP = (0.02, 0.8)
"""A foot is put elsewhere where it moves this far, meters, and by this share of all its movement in
the contact, within the time of a step."""


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
    """Seconds: shorter contacts are dropped, shorter gaps closed."""


def foot_contacts(
    joints: Float[np.ndarray, "frames joints 3"],
    fps: float,
    skeleton: Skeleton,
    settings: Contacts = Contacts(),
) -> Bool[np.ndarray, "frames feet"]:
    """Returns for each joint of the left foot, then of the right, whether it stands."""
    feet = joints[:, [*skeleton.left_foot, *skeleton.right_foot]]
    standing_height = np.percentile(feet[..., 1], 5, axis=0)
    left = len(skeleton.left_foot)
    if 2 * left == feet.shape[1]:  # both sides of a body are alike
        standing_height = np.tile(standing_height.reshape(2, left).min(axis=0), 2)
    height = feet[..., 1] - np.clip(standing_height, 0, 0.12)
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
    """Yields the first frame and the frame after the last of every contact of one joint."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], standing.astype(np.int8), [0]])))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _fill(standing: Bool[np.ndarray, " frames"], value: bool, longest: int) -> None:
    """Flips short intervals of `value` between others, in place."""
    for start, end in list(contact_intervals(standing == value)):
        inside = start > 0 and end < len(standing)
        if end - start <= longest and (inside or value):
            standing[start:end] = not value


@dataclass(frozen=True, eq=False)
class FootStance:
    """One foot over time."""

    path: Path
    """Position of the joint that carries the weight, up to a constant in each contact; y is 0."""
    speed: Float[np.ndarray, " frames"]
    """Sliding speed, meters per second."""
    intervals: tuple[Interval, ...]
    """The stance phases, in order."""

    @property
    def weight(self) -> Float[np.ndarray, " frames"]:
        """Confidence that the foot stands in each frame, given that it has contact."""
        return 1 / (1 + (self.speed / _SLOW) ** 2)

    def center(self, interval: Interval) -> Float[np.ndarray, " 3"]:
        """Returns the mean of the path over one contact, in which slow frames weigh most."""
        frames = slice(*interval)
        return np.average(self.path[frames], axis=0, weights=self.weight[frames])

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
            far: Meters, root mean square: it may move by the first all the same, by the second it
                slides.
        """
        path = self.path.copy()
        for interval in self.intervals:
            frames = slice(*interval)
            offset = self.path[frames] - self.center(interval)
            spread = np.sqrt(np.average((offset**2).sum(axis=-1), weights=self.weight[frames]))
            slow = np.quantile(self.speed[frames], 0.25)
            path[frames] = max(float(ramp(slow, *rest)), float(ramp(spread, *far))) * offset
        return replace(self, path=path)

    def broken_at_jumps(self, pause: int) -> FootStance:
        """Returns the same foot, contacts broken where it is put elsewhere and stands again."""

        def jumps(interval: Interval) -> bool:
            path, first = self.path[slice(*interval)], self._fastest(interval, pause) - interval[0]
            jump = np.linalg.norm(path[first + pause] - path[first])
            return bool(jump > max(_JUMP[0], _JUMP[1] * np.linalg.norm(np.ptp(path, axis=0))))

        return self._broken(jumps, pause)

    def broken_at_slips(self, slip: float, pause: int) -> FootStance:
        """Returns the same foot, contacts broken in which it slides farther than `slip`, meters."""

        def slips(interval: Interval) -> bool:
            offset = self.path[slice(*interval)] - self.center(interval)
            return bool(np.linalg.norm(offset, axis=-1).max() > slip)

        return self._broken(slips, pause)

    def _broken(self, condition: Callable[[Interval], bool], pause: int) -> FootStance:
        """Breaks contacts that meet `condition` by a gap of as many frames as a step takes."""
        kept, remaining = [], list(self.intervals)
        while remaining:
            start, end = interval = remaining.pop()
            if end - start > 3 * pause and condition(interval):
                first = self._fastest(interval, pause)
                remaining += [(start, first), (first + pause, end)]
            else:
                kept.append(interval)
        return replace(self, intervals=tuple(sorted(kept)))

    def _fastest(self, interval: Interval, pause: int) -> int:
        """Returns where the fastest `pause` frames begin; of equally fast ones, the middle."""
        path = self.path[slice(*interval)]
        distance = np.linalg.norm(path[pause:] - path[:-pause], axis=-1)
        middle = np.abs(np.linspace(-1, 1, len(distance)))
        inner = slice(pause, len(distance) - pause)
        return interval[0] + pause + int((distance * (1 - 0.2 * middle))[inner].argmax())


def foot_stance(
    pivots: Float[np.ndarray, "frames pivots 3"],
    standing: Bool[np.ndarray, "frames pivots"],
    fps: float,
    landing: float,
) -> FootStance:
    """Returns the stance of a foot: how the joint that carries the weight slides, and when.

    Args:
        pivots: Its joints that touch the floor, the one that holds longest last.
        standing: Whether each of them has contact.
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
    # Contacts lose their fast ends, except where the motion itself begins or stops.
    most, intervals = round(_ENDS * fps), []
    for start, end in contact_intervals(np.logical_or.reduce(standing, axis=1)):
        first, last = start, end
        while start > 0 and first < min(start + most, end) and speed[first] > landing:
            first += 1
        while end < len(speed) and last > max(end - most, first) and speed[last - 1] > landing:
            last -= 1
        if last - first > 1:
            intervals.append((first, last))
    return FootStance(path, speed, tuple(intervals))


def ramp(values: ArrayLike, low: float, high: float) -> np.ndarray:
    """Returns 0 below `low`, 1 above `high`, and a smooth step between."""
    u = np.clip((np.asarray(values) - low) / (high - low), 0, 1)
    return np.asarray(u * u * (3 - 2 * u))
