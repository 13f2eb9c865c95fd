"""A motion as curves over time: heights, headings, speeds, distances; and events of a curve."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

FPS = 20.0
"""Frames per second of all motions."""

LEFT, RIGHT = "left", "right"

_HIPS, _KNEES, _ANKLES, _TOES = (1, 2), (4, 5), (7, 8), (10, 11)
_SHOULDERS, _ELBOWS, _WRISTS = (16, 17), (18, 19), (20, 21)
_PELVIS, _NECK, _HEAD = 0, 12, 15

Curve = Float[np.ndarray, " frames"]
Span = tuple[int, int]
"""First frame of an event, and one past its last."""


class Body:
    """Curves of one motion.

    Args:
        joints: Positions of SMPL's 22 body joints, y up, meters, 20 frames per second.
    """

    def __init__(self, joints: Float[np.ndarray, "frames 22 3"]) -> None:
        joints = np.array(joints, np.float64)
        self.floor = float(np.percentile(joints[:, _TOES, 1].min(axis=1), 5))
        joints[..., 1] -= self.floor
        self.joints = smooth(joints, 1)
        thigh = np.linalg.norm(joints[:, _HIPS] - joints[:, _KNEES], axis=-1)
        shank = np.linalg.norm(joints[:, _KNEES] - joints[:, _ANKLES], axis=-1)
        self.leg = float(np.median(thigh + shank))
        upper = np.linalg.norm(joints[:, _SHOULDERS] - joints[:, _ELBOWS], axis=-1)
        lower = np.linalg.norm(joints[:, _ELBOWS] - joints[:, _WRISTS], axis=-1)
        self.arm = float(np.median(upper + lower))
        self.frames = len(joints)

    @property
    def seconds(self) -> float:
        """Length of the motion."""
        return self.frames / FPS

    def of(self, joints: tuple[int, int], side: str) -> Float[np.ndarray, "frames 3"]:
        """Returns the positions of one joint of a pair."""
        return self.joints[:, joints[side == RIGHT]]

    @cached_property
    def heading(self) -> Curve:
        """Direction that hips and shoulders face, radians without jumps; it grows to the left."""
        hips = self.joints[:, _HIPS[0]] - self.joints[:, _HIPS[1]]
        shoulders = self.joints[:, _SHOULDERS[0]] - self.joints[:, _SHOULDERS[1]]
        across = smooth(hips / 0.1 + shoulders / 0.35, 3)
        return np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))

    @cached_property
    def velocity(self) -> Float[np.ndarray, "frames 2"]:
        """Velocity of the pelvis ahead of the body and to its left, m/s."""
        moving = np.gradient(smooth(self.joints[:, _PELVIS][:, [0, 2]], 4), axis=0) * FPS
        x, z = moving.T
        sin, cos = np.sin(self.heading), np.cos(self.heading)
        return np.stack([x * sin + z * cos, x * cos - z * sin], axis=-1)

    @cached_property
    def speed(self) -> Curve:
        """Speed of the pelvis over the floor, m/s."""
        return np.linalg.norm(self.velocity, axis=-1)

    @property
    def way(self) -> float:
        """Length of the root's path along the floor, meters."""
        return float(self.speed.sum() / FPS)

    @property
    def away(self) -> float:
        """Distance from the first to the last position of the root, meters."""
        path = self.joints[:, _PELVIS][:, [0, 2]]
        return float(np.linalg.norm(path[-1] - path[0]))

    @cached_property
    def height(self) -> Curve:
        """Height of the pelvis as a share of its height in a standing body."""
        return self.joints[:, _PELVIS, 1] / (1.13 * self.leg)

    @cached_property
    def pitch(self) -> Curve:
        """Angle of the trunk to the vertical, degrees."""
        trunk = self.joints[:, _NECK] - self.joints[:, _PELVIS]
        return np.degrees(np.arccos(trunk[:, 1] / np.linalg.norm(trunk, axis=-1)))

    @property
    def head(self) -> Float[np.ndarray, "frames 3"]:
        """Position of the head."""
        return self.joints[:, _HEAD]

    def hand(self, side: str) -> Curve:
        """Height of a wrist above its shoulder, meters."""
        return (self.of(_WRISTS, side) - self.of(_SHOULDERS, side))[:, 1]

    def wrist(self, side: str) -> Float[np.ndarray, "frames 3"]:
        """A wrist from its shoulder: to the body's left, up, ahead, meters."""
        return self._turned(self.of(_WRISTS, side) - self.of(_SHOULDERS, side))

    def ankle(self, side: str) -> Float[np.ndarray, "frames 3"]:
        """An ankle from its hip: to the body's left, up, ahead, meters."""
        return self._turned(self.of(_ANKLES, side) - self.of(_HIPS, side))

    def foot(self, side: str) -> Curve:
        """Height of a foot's lowest point over where it stands, meters."""
        ankle, toe = self.of(_ANKLES, side)[:, 1], self.of(_TOES, side)[:, 1]
        return np.minimum(ankle - 0.07, toe)

    def lifted(self, side: str) -> Curve:
        """Height of an ankle above the other one, meters."""
        ankles = self.joints[:, _ANKLES, 1]
        return (ankles[:, 0] - ankles[:, 1]) * (1 if side == LEFT else -1)

    def knee(self, side: str) -> Curve:
        """Height of a knee below its hip, by the length of the thigh; 0 is a level thigh."""
        return (self.of(_HIPS, side) - self.of(_KNEES, side))[:, 1] / (0.5 * self.leg)

    def shin(self, side: str) -> Curve:
        """Height of a knee above the floor, meters."""
        return self.of(_KNEES, side)[:, 1]

    def stepping(self, side: str) -> Curve:
        """Speed of an ankle over the floor, m/s."""
        return np.linalg.norm(np.gradient(self.of(_ANKLES, side)[:, [0, 2]], axis=0), axis=-1) * FPS

    @property
    def hands_apart(self) -> Curve:
        """Distance of the wrists, meters."""
        return np.linalg.norm(self.joints[:, _WRISTS[0]] - self.joints[:, _WRISTS[1]], axis=-1)

    @property
    def hands_up(self) -> Curve:
        """Height of the higher wrist over the floor, meters."""
        return self.joints[:, _WRISTS, 1].max(axis=1)

    @property
    def hands_low(self) -> Curve:
        """Height of the lower wrist over the floor, meters."""
        return self.joints[:, _WRISTS, 1].min(axis=1)

    @property
    def hands_from_hips(self) -> Curve:
        """Distance of each wrist from its hip, the larger one, meters."""
        apart = self.joints[:, _WRISTS] - self.joints[:, _HIPS]
        return np.linalg.norm(apart, axis=-1).max(axis=1)

    @property
    def feet_apart(self) -> Curve:
        """Distance of the ankles over the floor, meters."""
        ankles = self.joints[:, _ANKLES][..., [0, 2]]
        return np.linalg.norm(ankles[:, 0] - ankles[:, 1], axis=-1)

    @cached_property
    def busy(self) -> Curve:
        """Speed of the fastest hand or foot, m/s."""
        ends = self.joints[:, [*_ANKLES, *_WRISTS]]
        return np.linalg.norm(np.gradient(smooth(ends, 2), axis=0), axis=-1).max(axis=1) * FPS

    def _turned(self, vectors: Float[np.ndarray, "frames 3"]) -> Float[np.ndarray, "frames 3"]:
        x, y, z = vectors.T
        sin, cos = np.sin(self.heading), np.cos(self.heading)
        return np.stack([x * cos - z * sin, y, x * sin + z * cos], axis=-1)


def smooth(values: np.ndarray, reach: int) -> np.ndarray:
    """Returns means over `reach` frames to either side, weighted by a triangle; ends are held."""
    weights = np.concatenate([np.arange(1, reach + 2), np.arange(reach, 0, -1)]).astype(float)
    padded = np.pad(values, [(reach, reach)] + [(0, 0)] * (values.ndim - 1), "edge")
    shifted = [padded[n : n + len(values)] * w for n, w in enumerate(weights)]
    return np.sum(shifted, axis=0) / weights.sum()


def spans(
    holds: Bool[np.ndarray, " frames"], shortest: float = 0.0, gap: float = 0.0
) -> list[Span]:
    """Returns where something holds for `shortest` seconds or more, across gaps up to `gap`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]])))
    joined: list[Span] = []
    for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if joined and start - joined[-1][1] <= gap * FPS:
            joined[-1] = (joined[-1][0], end)
        else:
            joined.append((start, end))
    return [(start, end) for start, end in joined if end - start >= shortest * FPS]


def swings(curve: Curve, low: float, high: float) -> list[Span]:
    """Returns the intervals from above `high` to below `low` again, one for each swing."""
    intervals, start = [], None
    for frame, value in enumerate(curve.tolist()):
        if start is None and value > high:
            start = frame
        elif start is not None and value < low:
            intervals.append((start, frame))
            start = None
    return intervals if start is None else [*intervals, (start, len(curve))]
