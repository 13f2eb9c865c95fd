"""Foot contacts and stance: when each foot joint stands, and how a foot slides while it does.

A contact begins where a joint is low and slow, and lasts until it is clearly high or fast; short
gaps are closed, very short contacts dropped. Speeds are means over three frames. Heights are
measured from the joint's own lowest ones, since an ankle stands higher than a toe.

The stance of a foot follows the joint that carries the weight, the toe rather than the ankle or
heel. A stance phase begins when the foot has come to rest and ends before it takes off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from latentmotion.arrays import Lengths, dot, length, quantile, real_frames
from latentmotion.kinematics.skeleton import BatchedJoints, Skeleton

Paths = Float[np.ndarray, "frames feet 3"]

# A foot, the first frame of a stance phase of it, and the frame after its last.
Phase = tuple[int, int, int]

# Meters per second: frames in which a foot is slower count most for where it stands.
_SLOW = 0.1

# Seconds at most by which a contact is shortened at either end.
_ENDS = 0.15

# A foot is put elsewhere where it moves this far, meters, and by this share of all its movement
# in the contact, within the time of a step.
_JUMP = (0.02, 0.8)


@dataclass(frozen=True)
class Contacts:
    """Thresholds of a standing foot. The first of a pair begins a contact, the second ends it."""

    height: tuple[float, float] = (0.04, 0.06)  # Meters above the joint's standing height.
    # Horizontal meters per second. Generous: a foot that slides should stand.
    speed: tuple[float, float] = (0.5, 0.75)
    climb: tuple[float, float] = (0.35, 0.6)  # Vertical meters per second.
    shortest: float = 0.1  # Seconds: shorter contacts are dropped, shorter gaps closed.


def foot_contacts(
    joints: BatchedJoints,
    fps: float,
    skeleton: Skeleton,
    settings: Contacts = Contacts(),
    lengths: Lengths = None,
) -> Bool[np.ndarray, "frames *batch feet"]:
    """Returns for each joint of the left foot, then of the right, whether it stands."""
    feet = joints[..., [*skeleton.left_foot, *skeleton.right_foot], :]
    standing_height = quantile(feet[..., 1], 0.05, lengths)
    left = len(skeleton.left_foot)
    if 2 * left == feet.shape[-2]:  # both sides of a body are alike
        standing_height = np.minimum(standing_height[..., :left], standing_height[..., left:])
        standing_height = np.concatenate([standing_height, standing_height], axis=-1)
    height = feet[..., 1] - np.clip(standing_height, 0, 0.12)
    moves = velocity(feet, fps, lengths)
    across, climb = length(moves[..., ::2]), np.abs(moves[..., 1])
    limits = (settings.height, settings.speed, settings.climb)
    begins, lasts = (
        (height < limits[0][n]) & (across < limits[1][n]) & (climb < limits[2][n]) for n in (0, 1)
    )
    if lengths is not None:
        lasts &= real_frames(lengths, len(joints))[..., None]
    # Contacts are where they last, as long as they begin somewhere; none and no gap is short.
    shortest, shape = max(1, round(settings.shortest * fps)), lasts.shape
    begins, lasts = (flags.reshape(len(flags), -1) for flags in (begins, lasts))
    begun = np.concatenate([np.zeros((1, lasts.shape[1]), int), np.cumsum(begins, axis=0)])
    foot, start, end = contact_phases(lasts).T
    begin = begun[end, foot] > begun[start, foot]
    foot, start, end = foot[begin], start[begin], end[begin]
    apart = (start[1:] - end[:-1] >= shortest) | (foot[1:] != foot[:-1])
    first, last = (np.ones(len(foot), bool) for _ in range(2))
    first[1:] = last[:-1] = apart
    foot, start, end = foot[first], start[first], end[last]
    long = end - start >= shortest
    steps = np.zeros((len(lasts) + 1, lasts.shape[1]), np.int8)
    steps[start[long], foot[long]], steps[end[long], foot[long]] = 1, -1
    return (np.cumsum(steps[:-1], axis=0) > 0).reshape(shape)


def contact_phases(standing: Bool[np.ndarray, "frames feet"]) -> Int[np.ndarray, "contacts 3"]:
    """Returns of every contact the foot, its first frame, and the frame after its last."""
    frames, feet = standing.shape
    line = np.zeros((feet, frames + 2), np.int8)  # foot after foot
    line[:, 1:-1] = standing.T
    line = line.ravel()
    foot, start = np.divmod(np.flatnonzero(line[1:] > line[:-1]), frames + 2)
    end = np.flatnonzero(line[1:] < line[:-1]) - foot * (frames + 2)
    return np.stack([foot, start, end], axis=1)


@dataclass(frozen=True, eq=False)
class FootStances:
    """When feet stand, and how surely."""

    speed: Float[np.ndarray, "frames feet"]  # Sliding speed, meters per second.
    phases: tuple[Phase, ...]  # The stance phases, foot by foot, in order.

    @cached_property
    def at(self) -> tuple[Int[np.ndarray, " standing"], Int[np.ndarray, " standing"]]:
        """Frames and feet of which the stance phases consist, one phase after the other."""
        foot, start, _ = np.array(self.phases, int).reshape(-1, 3).T
        return np.arange(len(self._phase)) + (start - self._first)[self._phase], foot[self._phase]

    @cached_property
    def weight(self) -> Float[np.ndarray, " standing"]:
        """Confidence that a foot stands in these frames."""
        return _confidence(self.speed[self.at])

    def mean(
        self, values: Float[np.ndarray, "standing channels"]
    ) -> Float[np.ndarray, "standing channels"]:
        """Returns in each frame the mean of values over its phase; slow frames weigh most."""
        return np.add.reduceat(self._share * values, self._first, axis=0)[self._phase]

    def eased(self, path: Paths, rest: tuple[float, float], far: tuple[float, float]) -> Paths:
        """Returns paths, kept only as far as feet slide in each contact.

        A foot that comes to rest for a quarter of its contact does not slide, whatever it does
        while it lands, rolls and takes off.

        Args:
            path: As `foot_stances` returns it.
            rest: Meters per second in that quarter: it rests below the first, slides above the
                second.
            far: Meters, root mean square: it may move by the first all the same, by the second it
                slides.
        """
        eased, standing = path.copy(), path[self.at]
        offset = standing - self.mean(standing)
        spread = np.sqrt(self.mean(dot(offset, offset)[:, None]))
        slow = [quantile(self.speed[start:end, foot], 0.25) for foot, start, end in self.phases]
        slides = ramp(np.array(slow), *rest)[self._phase, None]
        eased[self.at] = np.maximum(slides, ramp(spread, *far)) * offset
        return eased

    def broken_at_jumps(self, path: Paths, pause: int) -> FootStances:
        """Returns the stances, contacts broken where a foot is put elsewhere and stands again."""

        def jumps(phase: Phase) -> bool:
            foot, start, end = phase
            track = path[start:end, foot]
            way = length(track.max(axis=0) - track.min(axis=0))
            first = _fastest(track, pause) if way > _JUMP[0] else 0
            jump = length(track[first + pause] - track[first])
            return bool(jump > max(_JUMP[0], _JUMP[1] * way))

        return self._broken(path, jumps, pause)

    def broken_at_slips(self, path: Paths, slip: float, pause: int) -> FootStances:
        """Returns the stances, contacts broken in which a foot slides beyond `slip` meters."""

        def slips(phase: Phase) -> bool:
            foot, start, end = phase
            track, weight = path[start:end, foot], _confidence(self.speed[start:end, foot])
            offset = track - weight @ track / weight.sum()
            return bool(dot(offset, offset).max() > slip**2)

        return self._broken(path, slips, pause)

    def _broken(self, path: Paths, condition: Callable[[Phase], bool], pause: int) -> FootStances:
        """Breaks contacts that meet `condition` by a gap of as many frames as a step takes."""
        done, remaining = [], list(self.phases)
        while remaining:
            foot, start, end = phase = remaining.pop()
            if end - start > 3 * pause and condition(phase):
                first = start + _fastest(path[start:end, foot], pause)
                remaining += [(foot, start, first), (foot, first + pause, end)]
            else:
                done.append(phase)
        return self if len(done) == len(self.phases) else replace(self, phases=tuple(sorted(done)))

    @cached_property
    def _phase(self) -> Int[np.ndarray, " standing"]:
        counts = [end - start for _, start, end in self.phases]
        return np.repeat(np.arange(len(counts)), counts)

    @cached_property
    def _first(self) -> Int[np.ndarray, " phases"]:
        return np.searchsorted(self._phase, np.arange(len(self.phases)))

    @cached_property
    def _share(self) -> Float[np.ndarray, "standing 1"]:
        total = np.add.reduceat(self.weight, self._first)
        return (self.weight / total[self._phase])[:, None]


def _confidence(speed: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    return 1 / (1 + (speed / _SLOW) ** 2)


def _fastest(path: Float[np.ndarray, "frames 3"], pause: int) -> int:
    """Returns where the fastest `pause` frames begin; of equally fast ones, the middle."""
    distance = length(path[pause:] - path[:-pause])
    middle = np.abs(np.linspace(-1, 1, len(distance)))
    inner = slice(pause, len(distance) - pause)
    return pause + int((distance * (1 - 0.2 * middle))[inner].argmax())


def foot_stances(
    pivots: Float[np.ndarray, "frames feet pivots 3"],
    standing: Bool[np.ndarray, "frames feet pivots"],
    fps: float,
    landing: float,
    lengths: Lengths = None,
) -> tuple[Paths, FootStances]:
    """Returns how feet slide, and when they stand.

    Args:
        pivots: Their joints that touch the floor, the one that holds longest last.
        standing: Whether each of them has contact.
        fps: Frames per second.
        landing: Meters per second above which a foot that comes down or takes off does not stand.
        lengths: Frames of each foot's motion, where there is padding.

    Returns:
        Paths of the joints that carry the weight, up to a constant in each contact, y being 0; and
        the stances.
    """
    # The joint that carries the weight: one that stands before one that lands, toe before ankle.
    frames, feet, count, _ = pivots.shape
    holds = np.where(standing[1:] & standing[:-1], 2, standing[1:] | standing[:-1])
    carries = (holds * count + np.arange(count)).argmax(axis=-1)
    steps = np.diff(pivots, axis=0)[np.arange(frames - 1)[:, None], np.arange(feet), carries]
    path = np.zeros((frames, feet, 3))
    np.cumsum(steps * (1, 0, 1), axis=0, out=path[1:])
    speed = length(velocity(path, fps, lengths))
    # Contacts lose their fast ends, except where the motion itself begins or stops.
    most, phases, fast = round(_ENDS * fps), [], (speed > landing).T.tolist()
    stops = [frames] * feet if lengths is None else lengths.tolist()
    for foot, start, end in contact_phases(np.asarray(standing.any(axis=-1))).tolist():
        first, last = start, end
        while start > 0 and first < min(start + most, end) and fast[foot][first]:
            first += 1
        while end < stops[foot] and last > max(end - most, first) and fast[foot][last - 1]:
            last -= 1
        if last - first > 1:
            phases.append((foot, first, last))
    return path, FootStances(speed, tuple(phases))


def velocity(
    points: Float[np.ndarray, "frames ..."], fps: float, lengths: Lengths = None
) -> Float[np.ndarray, "frames ..."]:
    """Returns central differences, meters per second; zero for a single frame."""
    moved = np.zeros(points.shape)
    if len(points) > 1:
        moved[1:-1] = 0.5 * (points[2:] - points[:-2])
        moved[0], moved[-1] = points[1] - points[0], points[-1] - points[-2]
        if lengths is not None:
            motions = np.arange(len(lengths))
            moved[lengths - 1, motions] = (
                points[lengths - 1, motions] - points[lengths - 2, motions]
            )
    return fps * moved


def ramp(values: ArrayLike, low: float, high: float) -> np.ndarray:
    """Returns 0 below `low`, 1 above `high`, and a smooth step between."""
    u = np.minimum(np.maximum((np.asarray(values) - low) / (high - low), 0), 1)
    return np.asarray(u * u * (3 - 2 * u))
