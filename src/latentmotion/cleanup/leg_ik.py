"""Two-bone inverse kinematics: bends hip and knee so that the ankle reaches its goal.

The thigh and shank keep their lengths. The knee keeps to the side where it was: its distance from
the line hip–ankle is turned along with that line, and what it must bend beyond that it bends ahead.
A leg that already is where it should be does not change at all.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.rotations import quaternion_between, quaternion_rotate

Points = Float[np.ndarray, "frames 3"]


def reach(
    hip: Points, knee: Points, ankle: Points, goal: Points, ahead: Points
) -> tuple[Points, Points]:
    """Returns knee and ankle, the ankle at its goal or as near as the leg reaches.

    Args:
        hip: Where the leg hangs.
        knee: Where the knee was, for that hip.
        ankle: Where the ankle was.
        goal: Where the ankle should be.
        ahead: Where knees bend to.
    """
    thigh, shank = _norm(knee - hip), _norm(ankle - knee)
    axis = _unit(goal - hip)
    distance = np.clip(_norm(goal - hip), np.abs(thigh - shank) + 1e-6, thigh + shank)
    along = (thigh**2 - shank**2 + distance**2) / (2 * distance)
    radius = np.sqrt(np.maximum(thigh**2 - along**2, 0))
    before = _unit(ankle - hip)
    bend = (knee - hip) - before * _dot(before, knee - hip)
    turned = quaternion_rotate(quaternion_between(before, axis), bend)
    more = np.maximum(radius - _norm(bend), 0)
    side = turned + 2 * more * _unit(ahead - axis * _dot(axis, ahead))
    side = side + 1e-6 * np.cross(axis, np.roll(axis, 1, axis=-1) * (1, -1, 1))
    side = _unit(side - axis * _dot(axis, side))
    return hip + axis * along + side * radius, hip + axis * distance


def _dot(a: Points, b: Points) -> Float[np.ndarray, "frames 1"]:
    return (a * b).sum(-1, keepdims=True)


def _norm(a: Points) -> Float[np.ndarray, "frames 1"]:
    return np.linalg.norm(a, axis=-1, keepdims=True)


def _unit(a: Points) -> Points:
    return a / np.maximum(_norm(a), 1e-9)
