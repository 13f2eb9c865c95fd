"""Paths: a straight motion is bent onto a curve.

A model that has hardly seen curves walks straight well. So speed along the path is asked of it on a
straight line, and then the floor is bent: a point at z ahead and x aside goes to P(z) + x N(z). The
body turns with the curve as a whole. Feet take the map of their own place, which does not change
while they stand, so that planted feet stay planted; the legs follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.leg_ik import find_legs
from latentmotion.cleanup.leg_ik import reach as bend_leg
from latentmotion.cleanup.pipeline import ground_path
from latentmotion.control.goals import RootPath
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import Joints, Skeleton
from latentmotion.representation.canonical import turn

# Meters between the points by which a curve is kept.
_SPACING = 0.02

# Deviation, meters along the curve, of the Gaussian that rounds the direction of the body.
_ROUND = 0.15


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve on the floor by its length, straight beyond both ends."""

    along: Float[np.ndarray, " points"]  # Meters from its start.
    places: Float[np.ndarray, "points 2"]  # x and z there.
    directions: Float[np.ndarray, " points"]  # Radians from +z toward +x there, without jumps.
    # Meters from its start at which it passes the points that it was made from.
    marks: Float[np.ndarray, " marks"]

    @classmethod
    def through(cls, path: RootPath) -> Curve:
        """Returns the smooth curve through the points of a path (centripetal Catmull-Rom)."""
        points = np.array(path.points, float)
        ends = 2 * points[0] - points[1], 2 * points[-1] - points[-2]
        padded = np.concatenate([[ends[0]], points, [ends[1]]])
        pieces = []
        for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
            knots = np.cumsum(
                [0.0, *(float(np.linalg.norm(q - p)) ** 0.5 for p, q in ((a, b), (b, c), (c, d)))]
            )
            count = max(2, round(float(np.linalg.norm(c - b)) / (0.25 * _SPACING)))
            t = np.linspace(knots[1], knots[2], count + 1)[:-1, None]
            a1, a2, a3 = (
                _between(t, knots[n], knots[n + 1], p, q)
                for n, (p, q) in enumerate(((a, b), (b, c), (c, d)))
            )
            b1, b2 = (
                _between(t, knots[0], knots[2], a1, a2),
                _between(t, knots[1], knots[3], a2, a3),
            )
            pieces.append(_between(t, knots[1], knots[2], b1, b2))
        dense = np.concatenate([*pieces, points[-1:]])
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
        marks = length[np.cumsum([0, *(len(piece) for piece in pieces)])]
        along = np.linspace(0, length[-1], max(2, round(length[-1] / _SPACING)) + 1)
        places = np.stack([np.interp(along, length, column) for column in dense.T], axis=1)
        steps = np.gradient(places, along, axis=0)
        directions = np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))
        return cls(along, places, directions, marks)

    @property
    def length(self) -> float:
        """Meters."""
        return float(self.along[-1])

    def direction(self, along: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Returns the direction at a length, rounded where the curve has corners."""
        offsets = np.linspace(-3, 3, 25)
        weights = np.exp(-0.5 * offsets**2)
        headings = [np.interp(along + _ROUND * o, self.along, self.directions) for o in offsets]
        return np.tensordot(weights / weights.sum(), np.stack(headings), axes=1)

    def place(
        self, along: Float[np.ndarray, "*batch"], aside: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch 2"]:
        """Returns the point at a length of the curve and so far to the left of it."""
        inside = np.clip(along, 0, self.length)
        place = np.stack([np.interp(inside, self.along, c) for c in self.places.T], axis=-1)
        ends = np.interp(along, self.along, self.directions)
        over, direction = along - inside, self.direction(along)
        place = place + over[..., None] * np.stack([np.sin(ends), np.cos(ends)], axis=-1)
        return place + aside[..., None] * np.stack([np.cos(direction), -np.sin(direction)], axis=-1)


def straight_points(
    path: RootPath, curve: Curve, frames: int, fps: float
) -> tuple[Float[np.ndarray, " marks"], Float[np.ndarray, " marks"]]:
    """Returns when, and how far along the curve, the pelvis has to be: seconds and meters."""
    if path.at is not None:
        return np.array(path.at, float), curve.marks
    if path.pace is None:
        return np.array([0.0, (frames - 1) / fps]), np.array([0.0, curve.length])
    times = _paced(path, curve)
    last = (frames - 1) / fps
    if times[-1] > last + 1 / fps + 1e-6:
        raise InputError(
            f"at its pace the path of {curve.length:.1f} m takes {times[-1]:.1f} s: the motion "
            f"lasts {last:g} s; ask for more seconds or a faster pace"
        )
    # Between points, too, so that the pace is kept.
    parts = [np.linspace(a, b, max(1, round(b - a)) + 1)[:-1] for a, b in pairwise(times)]
    every = np.append(np.concatenate(parts), times[-1])
    part = np.minimum(np.searchsorted(times, every, "right") - 1, len(times) - 2)
    pace, passed = _paces(path), every - times[part]
    gain = np.diff(pace) / np.diff(times)  # a pace changes evenly between points
    return every, curve.marks[part] + pace[part] * passed + gain[part] * passed**2 / 2


def path_seconds(path: RootPath) -> float | None:
    """Returns how long a path takes; None where neither its times nor its pace say so."""
    if path.at is not None:
        return float(path.at[-1])
    return None if path.pace is None else float(_paced(path, Curve.through(path))[-1])


def _paces(path: RootPath) -> Float[np.ndarray, " points"]:
    return np.broadcast_to(np.array(path.pace, float), len(path.points))


def _paced(path: RootPath, curve: Curve) -> Float[np.ndarray, " points"]:
    """Returns when a path passes its points at its pace, seconds."""
    pace = _paces(path)
    return np.cumsum([0.0, *(np.diff(curve.marks) / ((pace[1:] + pace[:-1]) / 2))])


def bent(joints: Joints, curve: Curve, fps: float, skeleton: Skeleton) -> Joints:
    """Returns a motion along +z, bent onto a curve.

    Args:
        joints: Positions, meters; the motion starts at the origin.
        curve: Where z of the floor goes.
        fps: Frames per second.
        skeleton: Says what legs are.
    """
    root = joints[:, 0]
    # The body turns with where it is, not with the sway of its steps.
    direction = curve.direction(ground_path(joints, fps)[:, 2])
    spot = curve.place(root[:, 2], root[:, 0])
    moved = turn(joints - root[:, None] * (1, 0, 1), direction[:, None])
    moved[..., ::2] += spot[:, None]
    for leg in find_legs(skeleton):
        ankle = joints[:, leg.ankle]
        goal = moved[:, leg.ankle].copy()
        goal[:, ::2] = curve.place(ankle[:, 2], ankle[:, 0])
        facing = curve.direction(ankle[:, 2])
        foot = turn(joints[:, list(leg.below)] - ankle[:, None], facing[:, None])
        ahead = turn(np.broadcast_to(np.array([0.0, 0.0, 1.0]), ankle.shape), direction)
        knee, ankle = bend_leg(
            moved[:, leg.hip], moved[:, leg.knee], moved[:, leg.ankle], goal, ahead
        )
        moved[:, leg.knee], moved[:, leg.ankle] = knee, ankle
        moved[:, list(leg.below)] = ankle[:, None] + foot
    return moved


def straightened(
    goal: tuple[float, ...], pelvis: tuple[float, float], along: float, curve: Curve
) -> tuple[float, float, float]:
    """Returns where on the straight line a point of the world is.

    Args:
        goal: x, y and z of the point.
        pelvis: x and z of the pelvis on the straight line.
        along: How far the body is, without the sway of its steps.
        curve: The curve.
    """
    (x, y, z), (aside, ahead) = goal, pelvis
    here = curve.place(np.array(ahead), np.array(aside))
    away = turn(np.array([x - here[0], y, z - here[1]]), -curve.direction(np.array(along)))
    return float(away[0]) + aside, float(away[1]), float(away[2]) + ahead


def _between(
    t: Float[np.ndarray, "n 1"], a: float, b: float, p: np.ndarray, q: np.ndarray
) -> np.ndarray:
    return ((b - t) * p + (t - a) * q) / (b - a)
