"""Checks that every reader of motion makes: rates, sizes before memory is taken, finite results."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from latentmotion.errors import FileFormatError
from latentmotion.kinematics.animation import Animation
from latentmotion.storage.limits import (
    FARTHEST,
    FILLED_FACTOR,
    LEAST_FPS,
    MOST_FILLED,
    MOST_FPS,
)


def checked_rate(path: str | Path, fps: float, line: int | None = None) -> float:
    """Returns a frame rate that a file states.

    Raises:
        FileFormatError: It is no number, or out of range.
    """
    if not LEAST_FPS <= fps <= MOST_FPS:
        problem = f"{fps:g} frames per second, expected {LEAST_FPS:g} to {MOST_FPS:,.0f}"
        raise FileFormatError(path, problem, line)
    return float(fps)


def check_filled(path: str | Path, frames: int, joints: int, stated: int) -> None:
    """Checks how much an animation will have, before it is made.

    Args:
        path: The file, for the error.
        frames: Number of frames, of all takes.
        joints: Number of joints.
        stated: Numbers that the file has.

    Raises:
        FileFormatError: It is far more than the file states.
    """
    most = max(MOST_FILLED, FILLED_FACTOR * stated)
    if frames * joints > most:
        problem = f"{frames:,} frames of {joints:,} joints, of which it states {stated:,} numbers"
        raise FileFormatError(
            path, f"{problem}; at most {most:,} frames times joints are filled in"
        )


def checked_animation(path: str | Path, animation: Animation) -> Animation:
    """Returns an animation whose numbers are finite and near enough to be counted in float32.

    Raises:
        FileFormatError: They are not.
    """
    far = (animation.skeleton.offsets, animation.root_positions, animation.translations)
    near = all(part is None or (np.abs(part) <= FARTHEST).all() for part in far)
    if not (near and np.isfinite(animation.rotations).all()):
        problem = f"holds numbers that are not finite, or places beyond {FARTHEST:,.0f} m"
        raise FileFormatError(path, f"{problem}; repair it, or check its unit of length")
    return animation
