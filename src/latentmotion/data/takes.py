"""Takes on disk: finding their files, and their joints at the frame rate of the data set.

Frame rates change by taking every n-th frame where that is exact, and by interpolation elsewhere.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import DataError, InputError
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.humanoid import JointMap, to_humanml3d
from latentmotion.storage.limits import MOST_FRAMES, UNPACKED_FACTOR

FPS = 20
"""Frames per second of prepared data, as in HumanML3D."""


def files_below(folder: Path, endings: Collection[str]) -> list[Path]:
    """Returns the files below a folder by their endings, sorted; links to folders are followed.

    Args:
        folder: Where to look, at any depth.
        endings: Endings in lower case, as `.bvh`; those of files may be in either.
    """
    files, visited = [], set()
    for directory, subfolders, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(directory)
        if real in visited:  # A link that leads back.
            subfolders.clear()
            continue
        visited.add(real)
        files += [Path(directory, name) for name in names if Path(name).suffix.lower() in endings]
    return sorted(files)


def joints_at(
    animation: Animation, fps: float, native_fps: float, joint_map: JointMap | None = None
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns HumanML3D's joints of an animation at another frame rate.

    Args:
        animation: Any skeleton.
        fps: Frames per second wanted.
        native_fps: Frames per second of the animation (files often say it wrongly).
        joint_map: How to find the joints; found by the skeleton's names if absent.

    Returns:
        Joints: frame i is taken at i/fps seconds, so that the first frame always stays.

    Raises:
        DataError: The animation has a lower frame rate than a third of the wanted one.
    """
    if native_fps * 3 < fps:
        raise DataError(
            f"{native_fps:g} frames per second are too few for {fps:g}; check the rate given"
        )
    step = whole_step(fps, native_fps)
    if step is not None:
        return to_humanml3d(every(animation, step), joint_map)
    return interpolate(to_humanml3d(animation, joint_map), native_fps / fps)


def whole_step(fps: float, native_fps: float) -> int | None:
    """Returns n where every n-th frame makes the wanted rate, or None where none does."""
    step = round(native_fps / fps)
    exact = step >= 1 and math.isclose(native_fps / fps, step, rel_tol=0.005)
    return step if exact else None


def every(animation: Animation, step: int, start: int = 0) -> Animation:
    """Returns every `step`-th frame from `start` on."""
    translations = animation.translations
    return Animation(
        skeleton=animation.skeleton,
        rotations=animation.rotations[start::step],
        root_positions=animation.root_positions[start::step],
        fps=animation.fps / step,
        translations=None if translations is None else translations[start::step],
    )


def interpolate(
    joints: Float[np.ndarray, "frames joints 3"], step: float
) -> Float[np.ndarray, "times joints 3"]:
    """Returns joints at every `step`-th frame, in between frames by straight lines.

    Raises:
        InputError: They would be too many.
    """
    if not (len(joints) - 1) / step <= max(MOST_FRAMES, UNPACKED_FACTOR * len(joints)):
        raise InputError(f"{len(joints):,} frames at {step:g} times the rate; check the frame rate")
    times = np.arange(0, len(joints) - 1 + 1e-6, step)
    before = np.minimum(times.astype(int), len(joints) - 2)
    weight = (times - before)[:, None, None].astype(joints.dtype)
    return joints[before] * (1 - weight) + joints[before + 1] * weight
