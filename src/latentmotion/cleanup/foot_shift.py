"""How far a foot must be moved for it not to slide, and to pass above the floor while it swings.

1. While a foot stands, it is shifted by what its pivot (the toe, else the ankle or heel) slides:
       c_{t+1} = c_t − (pivot_{t+1} − pivot_t),   horizontally, with mean 0 over the contact.
   A contact in which it slides far is broken by a small step.
2. Between contacts c is a cubic that leaves one and meets the next with the velocity at which the
   foot's own has gone to zero, so that no foot starts or stops with a jerk.
3. Joints below the floor are lifted onto it, and toes that would brush it while they swing pass
   above it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.contacts import spans
from latentmotion.cleanup.smoothing import upper_envelope


@dataclass(frozen=True)
class FootLock:
    """How feet are held."""

    blend: float = 0.3
    """Seconds in which a foot returns to its own path where no other contact follows soon."""
    slip: float = 0.1
    """Meters that a foot is held against; where it slid farther, it takes a small step."""
    clearance: float = 0.03
    """Height, meters, at which a foot joint that swings passes over the floor at least."""
    step: float = 0.06
    """Height, meters, of the step of a foot that is put elsewhere."""
    lower: float = 0.05
    """Meters that the pelvis may come down where a leg is too short."""
    stretch: float = 0.99
    """Share of its length that a leg is stretched to at most, unless it was more already."""


def foot_shift(
    pivots: Float[np.ndarray, "frames pivots 3"],
    standing: Bool[np.ndarray, "frames pivots"],
    fps: float,
    settings: FootLock,
) -> Float[np.ndarray, "frames 3"]:
    """Returns the way from where a foot is to where it should be.

    Args:
        pivots: Its joints that touch the floor.
        standing: Whether they do.
        fps: Frames per second.
        settings: How feet are held.
    """
    standing = _with_steps(pivots, standing, fps, settings)
    shift = _slide_correction(pivots, standing, fps, settings)
    return shift + _lift(pivots, shift, standing, fps, settings)


def _with_steps(
    pivots: Float[np.ndarray, "frames pivots 3"],
    standing: Bool[np.ndarray, "frames pivots"],
    fps: float,
    settings: FootLock,
) -> Bool[np.ndarray, "frames pivots"]:
    """Breaks contacts in which the foot slides too far, where it slides fastest."""
    standing, pause = standing.copy(), max(1, round(settings.blend * fps * 0.75))
    open_periods = list(spans(_on(standing)))
    while open_periods:
        start, end = open_periods.pop()
        path = _path(_slides(pivots, standing)[start : end - 1])
        far = np.linalg.norm(path - path.mean(axis=0), axis=-1).max()
        if far > settings.slip and end - start > 3 * pause:
            first = start + _fastest(path, pause)
            standing[first : first + pause] = False
            open_periods += [(start, first), (first + pause, end)]
    return standing


def _fastest(path: Float[np.ndarray, "frames 3"], pause: int) -> int:
    """Returns the start of the stretch in which most way is made, of equal ones the middle one."""
    way = np.linalg.norm(path[pause:] - path[:-pause], axis=-1)
    middle = np.abs(np.linspace(-1, 1, len(way)))
    inner = slice(pause, len(way) - pause)
    return pause + int((way * (1 - 0.2 * middle))[inner].argmax())


def _path(slides: Float[np.ndarray, "steps 3"]) -> Float[np.ndarray, "frames 3"]:
    return np.concatenate([np.zeros((1, 3)), np.cumsum(slides, axis=0)])


def _slide_correction(
    pivots: Float[np.ndarray, "frames pivots 3"],
    standing: Bool[np.ndarray, "frames pivots"],
    fps: float,
    settings: FootLock,
) -> Float[np.ndarray, "frames 3"]:
    """Returns how far a foot must be shifted for its pivot not to slide."""
    slides = _slides(pivots, standing)
    shift = np.zeros((len(pivots), 3))
    periods = list(spans(_on(standing)))
    for start, end in periods:
        path = _path(slides[start : end - 1])
        shift[start:end] = path.mean(axis=0) - path
    for gap in _gaps(periods, len(pivots)):
        _bridge(shift, -slides, gap, max(1, round(settings.blend * fps)))
    return shift


def _slides(
    pivots: Float[np.ndarray, "frames pivots 3"], standing: Bool[np.ndarray, "frames pivots"]
) -> Float[np.ndarray, "steps 3"]:
    """Returns the horizontal step of the joint that bears the foot, toe before ankle."""
    steps = np.diff(pivots, axis=0) * (1, 0, 1)
    holds = np.where(standing[1:] & standing[:-1], 2, standing[1:] | standing[:-1])
    rank = holds * len(pivots[0]) + np.arange(len(pivots[0]))
    return np.take_along_axis(steps, rank.argmax(axis=1)[:, None, None], axis=1)[:, 0]


def _gaps(periods: list[tuple[int, int]], frames: int) -> list[tuple[int | None, int | None]]:
    """Returns last and first standing frame around each stretch without contact."""
    before: list[int | None] = [None, *(end - 1 for _, end in periods)]
    after: list[int | None] = [*(start for start, _ in periods), None]
    return [
        (a, b)
        for a, b in zip(before, after, strict=True)
        if (a is not None or b is not None) and (frames - 1 if a is None else a) != b
    ]


@dataclass(frozen=True)
class _Knot:
    frame: int
    value: Float[np.ndarray, " 3"]
    slope: Float[np.ndarray, " 3"]


def _bridge(
    shift: Float[np.ndarray, "frames 3"],
    velocity: Float[np.ndarray, "steps 3"],
    gap: tuple[int | None, int | None],
    blend: int,
) -> None:
    """Fills a gap in place: from one contact's shift to the next's, or to none in between."""
    (left, right), none = gap, np.zeros(3)
    knots = []
    if left is not None:
        slope = velocity[min(left, len(velocity) - 1)]
        knots += [_Knot(left, shift[left], slope), _Knot(left + blend, none, none)]
    if right is not None:
        slope = velocity[max(right - 1, 0)]
        knots += [_Knot(right - blend, none, none), _Knot(right, shift[right], slope)]
    if left is not None and right is not None and right - left < 2 * blend:
        knots = [knots[0], knots[-1]]
    for a, b in pairwise(knots):
        _cubic(shift, a, b)


def _cubic(shift: Float[np.ndarray, "frames 3"], a: _Knot, b: _Knot) -> None:
    """Writes the cubic between two knots, themselves left out (Hermite)."""
    frames = np.arange(max(a.frame + 1, 0), min(b.frame, len(shift)))
    length = max(b.frame - a.frame, 1)
    u = ((frames - a.frame) / length)[:, None]
    rise = length * (u * (1 - u) ** 2 * a.slope - u**2 * (1 - u) * b.slope)
    ease = u**2 * (3 - 2 * u)
    shift[frames] = (1 - ease) * a.value + ease * b.value + rise


def _lift(
    pivots: Float[np.ndarray, "frames pivots 3"],
    shift: Float[np.ndarray, "frames 3"],
    standing: Bool[np.ndarray, "frames pivots"],
    fps: float,
    settings: FootLock,
) -> Float[np.ndarray, "frames 3"]:
    """Returns how far a foot must be raised to stand on the floor, and to swing above it."""
    height = np.maximum(
        settings.clearance * _ramp(_speed(pivots, fps), 0.2, 0.6),
        settings.step * _ramp(_speed(shift[:, None], fps), 0.2, 0.6),
    )
    height = height * _away(_on(standing), 0.15 * fps)[:, None]
    need = np.maximum(0, height - pivots[..., 1]).max(axis=1)
    up = upper_envelope(need, max(1, round(0.1 * fps)))
    return np.stack([0 * up, up, 0 * up], axis=-1)


def _speed(
    points: Float[np.ndarray, "frames pivots 3"], fps: float
) -> Float[np.ndarray, "frames pivots"]:
    if len(points) < 2:
        return np.zeros(points.shape[:2])
    return np.linalg.norm(np.gradient(points, axis=0)[..., ::2], axis=-1) * fps


def _away(standing: Bool[np.ndarray, " frames"], ramp: float) -> Float[np.ndarray, " frames"]:
    """Returns 0 in contact, rising to 1 as many frames away from it as `ramp` says."""
    frames = np.arange(len(standing))
    contact = frames[standing]
    if not len(contact):
        return np.ones(len(standing))
    return _ramp(np.abs(frames[:, None] - contact).min(axis=1), 0.0, ramp)


def _ramp(values: np.ndarray, low: float, high: float) -> np.ndarray:
    u = np.clip((values - low) / (high - low), 0, 1)
    return u * u * (3 - 2 * u)


def _on(standing: Bool[np.ndarray, "frames pivots"]) -> Bool[np.ndarray, " frames"]:
    return np.logical_or.reduce(standing, axis=1)
