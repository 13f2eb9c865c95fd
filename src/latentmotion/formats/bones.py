"""Bones of foreign files, whose rests are turned and scaled, as plain ones whose rests are not.

With W the rotation of a joint in the world and W₀ the same at rest, its turn in the world's axes
is D = W W₀ᵀ. What an `Animation` holds follows from that and the positions p, all scales in them:

    rotation  R = D_parentᵀ D        offset  o = p₀ − p₀_parent        p = p_parent + D_parent o
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.skeleton import Skeleton

_STILL = 1e-5
"""Meters up to which a joint counts as staying where its parent carries it."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Where joints are and how they are turned in the world, over time or once."""

    positions: Float[np.ndarray, "... joints 3"]
    """Meters, y up."""
    turns: Float[np.ndarray, "... joints 3 3"]
    """Rotations."""


def plain_skeleton(name: str, names: Sequence[str], parents: Sequence[int], rest: Pose) -> Skeleton:
    """Returns bones as they lie in the world at rest; names that come up again are numbered."""
    offsets = rest.positions - rest.positions[[max(parent, 0) for parent in parents]]
    return Skeleton(name, _distinct(names), tuple(parents), offsets)


def plain_animation(skeleton: Skeleton, rest: Pose, moved: Pose, fps: float) -> Animation:
    """Returns how `plain_skeleton`'s joints turn, and move if they do more than turn."""
    world = moved.turns @ np.swapaxes(rest.turns, -1, -2)
    inner = list(skeleton.parents[1:])
    rotations, places = world.copy(), np.zeros_like(moved.positions)
    rotations[:, 1:] = np.swapaxes(world[:, inner], -1, -2) @ world[:, 1:]
    steps = moved.positions[:, 1:] - moved.positions[:, inner]
    places[:, 1:] = np.einsum("tjab,tja->tjb", world[:, inner], steps)
    moves = np.abs(places - skeleton.offsets).max() > _STILL
    track = places if moves else None
    return Animation(skeleton, rotations, moved.positions[:, 0].copy(), fps, track)


def even_rate(
    seconds: Float[np.ndarray, " keys"], otherwise: float = 30.0
) -> tuple[float, Float[np.ndarray, " frames"]]:
    """Returns the frame rate on which all keys fall, or another, and the time of each frame.

    Args:
        seconds: Times of keys, rising.
        otherwise: Frames per second where the keys lie unevenly or far apart.
    """
    if not len(seconds):
        return otherwise, np.zeros(1)
    fps = _rate(seconds) or otherwise
    count = round(float(seconds[-1] - seconds[0]) * fps) + 1
    return fps, seconds[0] + np.arange(count) / fps


def _rate(keys: Float[np.ndarray, " keys"]) -> float | None:
    """Returns the rate of evenly laid keys, a whole number where it is near one."""
    steps = np.diff(keys)
    steps = steps[steps > 0.5 / _MOST_FPS]
    if not len(steps):
        return None
    length = float(keys[-1] - keys[0])
    fps = max(round(length / float(np.median(steps))), 1) / length
    whole = float(round(fps))
    fps = whole if whole and abs(fps - whole) < 2e-4 * fps else fps
    places = (keys - keys[0]) * fps
    even = np.abs(places - np.round(places)).max() < 0.02
    return fps if even and _LEAST_FPS <= fps <= _MOST_FPS else None


_LEAST_FPS, _MOST_FPS = 8.0, 1000.0
"""Rates that keys can have been sampled at; others are those of keys set by hand."""


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    seen: dict[str, int] = {}
    distinct = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        distinct.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    return tuple(distinct)
