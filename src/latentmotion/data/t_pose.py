"""The T-pose before the motion in BVH conversions of CMU, and the frames that are drawn to it."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from latentmotion.skeleton import HUMANML3D

BLENDED = 6
"""Frames of a BVH file after the T-pose that are drawn towards it, at the native rate."""


def without_blend(
    joints: Float[np.ndarray, "frames joints 3"], native: float, fps: float
) -> Float[np.ndarray, "frames joints 3"]:
    """Puts a straight continuation of what follows in place of the frames next to the T-pose.

    Args:
        joints: HumanML3D's joints at `fps`, without the T-pose itself.
        native: Frames per second of the file.
        fps: Frames per second of `joints`.
    """
    count = math.ceil(BLENDED * fps / native)
    if len(joints) < count + 2:
        return joints
    step = joints[count + 1] - joints[count]
    back = np.arange(-count, 0)[:, None, None]
    before = joints[count] + back * step
    return np.concatenate([_with_bones_of(joints[count], before), joints[count:]])


def _with_bones_of(
    model: Float[np.ndarray, "joints 3"], joints: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, "frames joints 3"]:
    """Gives poses the bone lengths of another one, by moving joints along their bones."""
    placed = joints.copy()
    for joint, parent in list(enumerate(HUMANML3D.parents))[1:]:
        bone = joints[:, joint] - joints[:, parent]
        length = np.linalg.norm(model[joint] - model[parent])
        bone *= length / np.linalg.norm(bone, axis=-1, keepdims=True)
        placed[:, joint] = placed[:, parent] + bone
    return placed
