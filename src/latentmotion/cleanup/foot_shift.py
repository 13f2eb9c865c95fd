"""How far a foot must be moved for it not to slide.

1. While a foot stands, it is shifted from its path to the place where it is slowest; a contact in
   which it slides far is broken by a small step.
2. Between contacts the shift is a cubic that leaves one and meets the next with the velocity at
   which the foot's own has gone to zero, so that no foot starts or stops with a jerk.
3. Joints below the floor are lifted onto it. Feet that are put elsewhere pass above it, and those
   that swing fast as high as 19 of 20 in mocap do.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.contacts import FootStance, Path, ramp
from latentmotion.cleanup.smoothing import upper_envelope


@dataclass(frozen=True)
class FootLock:
    """How feet are held."""

    rest: tuple[float, float] = (0.045, 0.085)
    """Meters per second: a foot that is slower than the first for a quarter of its contact rests,
    and is left alone; one that is faster than the second slides, and is held."""
    far: tuple[float, float] = (0.02, 0.035)
    """Meters, root mean square, that a foot which rests may get about; beyond it is held, too."""
    landing: float = 0.7
    """Meters per second at which a foot that comes down or takes off is not held."""
    blend: float = 0.4
    """Seconds in which a foot returns to its own path where no other contact follows soon."""
    slip: float = 0.15
    """Meters that a foot is held against; where it slid farther, it takes a small step."""
    step: float = 0.03
    """Height, meters, of the step of a foot that is put elsewhere."""
    clearance: float = 0.02
    """Height, meters, of foot joints that swing faster than 0.8 m/s."""
    stay: float = 1.0
    """How much the body stays where it is, rather than follow planted feet that slide with it."""
    lower: float = 0.03
    """Meters that the pelvis may come down where a leg is too short."""
    stretch: tuple[float, float] = (0.92, 0.995)
    """Shares of its length: a leg is stretched softly beyond the first, never beyond the second,
    unless it was more already."""

    def pause(self, fps: float) -> int:
        """Returns how many frames a step takes."""
        return max(1, round(0.75 * self.blend * fps))


def foot_shift(
    pivots: Float[np.ndarray, "frames pivots 3"], foot: FootStance, fps: float, settings: FootLock
) -> Path:
    """Returns the way from where a foot is to where it should be.

    Args:
        pivots: Its joints that touch the floor.
        foot: Its stance.
        fps: Frames per second.
        settings: How feet are held.
    """
    foot = foot.broken_at_slips(settings.slip, settings.pause(fps))
    shift = _hold(foot, max(1, round(settings.blend * fps)))
    return shift + _lift(pivots, shift, foot, fps, settings)


def _hold(foot: FootStance, blend: int) -> Path:
    """Returns how far a foot must be shifted along the floor for it not to slide."""
    shift = np.zeros_like(foot.path)
    for interval in foot.intervals:
        part = slice(*interval)
        shift[part] = foot.center(interval) - foot.path[part]
    before: list[int | None] = [None, *(end - 1 for _, end in foot.intervals)]
    after: list[int | None] = [*(start for start, _ in foot.intervals), None]
    for last, first in zip(before, after, strict=True):
        whole = last is None and first is None
        if not whole and (len(shift) - 1 if last is None else last) != first:
            _bridge(shift, (last, first), blend)
    return shift


@dataclass(frozen=True)
class _Knot:
    frame: int
    value: Float[np.ndarray, " 3"]
    slope: Float[np.ndarray, " 3"]


def _bridge(shift: Path, gap: tuple[int | None, int | None], blend: int) -> None:
    """Fills a gap in place: from one contact's shift to the next's, or to none in between."""
    (left, right), none = gap, np.zeros(3)
    knots = []
    if left is not None:
        leaving = _Knot(left, shift[left], shift[left] - shift[left - 1])
        knots += [leaving, _Knot(left + blend, none, none)]
    if right is not None:
        meeting = _Knot(right, shift[right], shift[right + 1] - shift[right])
        knots += [_Knot(right - blend, none, none), meeting]
    if left is not None and right is not None and right - left < 2 * blend:
        knots = [knots[0], knots[-1]]
    for a, b in pairwise(knots):  # the cubic between two knots, themselves left out (Hermite)
        frames = np.arange(max(a.frame + 1, 0), min(b.frame, len(shift)))
        length = max(b.frame - a.frame, 1)
        u = ((frames - a.frame) / length)[:, None]
        rise = length * (u * (1 - u) ** 2 * a.slope - u**2 * (1 - u) * b.slope)
        ease = u**2 * (3 - 2 * u)
        shift[frames] = (1 - ease) * a.value + ease * b.value + rise


def _lift(
    pivots: Float[np.ndarray, "frames pivots 3"],
    shift: Path,
    foot: FootStance,
    fps: float,
    settings: FootLock,
) -> Path:
    """Returns how far a foot must be raised not to be below the floor, and to step over it."""
    height = np.maximum(
        settings.clearance * ramp(_speed(pivots + shift[:, None], fps), 0.4, 0.8),
        settings.step * ramp(_speed(shift[:, None], fps), 0.2, 0.6),
    )
    frames, distance = np.arange(len(foot.path)), np.full(len(foot.path), np.inf)
    for start, end in foot.intervals:
        outside = np.maximum(start - frames, frames - (end - 1))
        distance = np.minimum(distance, np.maximum(0, outside))
    height = height * ramp(distance, 0.0, 0.15 * fps)[:, None]
    need = np.maximum(0, height - pivots[..., 1]).max(axis=1)
    up = upper_envelope(need, max(1, round(0.1 * fps)))
    return up[:, None] * (0, 1, 0)


def _speed(
    points: Float[np.ndarray, "frames pivots 3"], fps: float
) -> Float[np.ndarray, "frames pivots"]:
    if len(points) < 2:
        return np.zeros(points.shape[:2])
    return np.linalg.norm(np.gradient(points, axis=0)[..., ::2], axis=-1) * fps
