"""Foot contacts: when each foot joint stands, from its height and speed, with hysteresis.

A contact begins where a joint is low and slow, and lasts until it is clearly high or fast; short
gaps are closed, contacts of a blink are dropped. Speeds are means over three frames. A joint's
own lowest heights say what low means, as an ankle stands higher than a toe.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.kinematics.skeleton import Skeleton


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
    across, climb = _speeds(feet, fps)
    limits = (settings.height, settings.speed, settings.climb)
    begins, lasts = (
        (height < limits[0][n]) & (across < limits[1][n]) & (climb < limits[2][n]) for n in (0, 1)
    )
    contacts = np.stack(
        [_hysteresis(*pair) for pair in zip(begins.T, lasts.T, strict=True)], axis=1
    )
    frames = max(1, round(settings.shortest * fps))
    for column in contacts.T:
        _fill(column, False, frames - 1)
        _fill(column, True, frames - 1)
    return contacts


def spans(standing: Bool[np.ndarray, " frames"]) -> Iterator[tuple[int, int]]:
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


def _speeds(
    feet: Float[np.ndarray, "frames feet 3"], fps: float
) -> tuple[Float[np.ndarray, "frames feet"], Float[np.ndarray, "frames feet"]]:
    """Returns horizontal and vertical speeds, m/s: means of the steps before and after a frame."""
    if len(feet) < 2:
        return np.zeros(feet.shape[:2]), np.zeros(feet.shape[:2])
    velocity = np.gradient(feet, axis=0) * fps
    return np.linalg.norm(velocity[..., ::2], axis=-1), np.abs(velocity[..., 1])


def _hysteresis(
    begins: Bool[np.ndarray, " frames"], lasts: Bool[np.ndarray, " frames"]
) -> Bool[np.ndarray, " frames"]:
    """Keeps those stretches of `lasts` in which `begins` is true somewhere."""
    kept = np.zeros_like(lasts)
    for start, end in spans(lasts):
        kept[start:end] = begins[start:end].any()
    return kept


def _fill(standing: Bool[np.ndarray, " frames"], value: bool, longest: int) -> None:
    """Flips stretches of `value` that are short and lie between others, in place."""
    for start, end in list(spans(standing == value)):
        inside = start > 0 and end < len(standing)
        if end - start <= longest and (inside or value):
            standing[start:end] = not value
