"""Figures that do one known thing: walk, turn, swing a joint."""

from __future__ import annotations

import numpy as np

from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D

FPS = 20.0


def figure(
    seconds: float,
    speed: float = 0.0,
    turn: float = 0.0,
    way: float = 0.0,
    height: np.ndarray | None = None,
    swings: dict[str, np.ndarray] | None = None,
) -> np.ndarray:
    """A figure with arms hanging that goes `way` degrees left of ahead and turns left evenly."""
    frames = round(seconds * FPS)
    time = np.arange(frames) / FPS
    vectors = np.zeros((frames, len(HUMANML3D), 3))
    heading = np.radians(turn) * time / max(seconds, 1e-9)
    vectors[:, 0, 1] = heading
    if speed:
        stride = np.sin(2 * np.pi * 0.9 * time)
        for side, sign in (("left", 1), ("right", -1)):
            vectors[:, HUMANML3D.names.index(f"{side}_hip"), 0] = -0.4 * sign * stride
            vectors[:, HUMANML3D.names.index(f"{side}_knee"), 0] = 0.35 + 0.3 * sign * stride
    for name, angles in (swings or {}).items():
        vectors[:, HUMANML3D.names.index(name)] = angles
    along = heading + np.radians(way)
    root = np.zeros((frames, 3))
    root[:, 0] = np.cumsum(np.sin(along)) * speed / FPS
    root[:, 2] = np.cumsum(np.cos(along)) * speed / FPS
    root[:, 1] = 0.92 if height is None else height
    return HUMANML3D.forward_kinematics(matrix_from_axis_angle(vectors), root)


def raised(frames: int, axis: float) -> np.ndarray:
    """An arm that hangs, goes up and comes down again."""
    angles = np.zeros((frames, 3))
    angles[:, 2] = axis * np.sin(np.pi * np.arange(frames) / frames) ** 2
    return angles


def mirrored(joints: np.ndarray) -> np.ndarray:
    return joints[:, list(HUMANML3D.mirror)] * np.array([-1, 1, 1])
