"""The T-pose that conversions of CMU to BVH put before the motion, and what they blend with it."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import unit
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.skeleton import HUMANML3D

BLENDED = 6
"""Frames of a BVH file after the T-pose that may be drawn towards it, at the native rate."""
REST = 4.0
"""Degrees that the joints of a T-pose are turned at the most, on average.

In the conversions of CMU it is 1.1 to 2.8; the motions themselves begin at 7 to 32.
"""
BLENDS = 0.8
"""Turn of the frame after the T-pose, as a part of that when the blend is over, if there is one.

0.3 to 0.65 in the Daz-friendly conversion, which blends, and 0.99 in the other, which does not.
"""


def begins_with_t_pose(animation: Animation) -> bool:
    """Returns whether frame 0 is the skeleton's rest pose and the motion is far from it."""
    turns = _turns(animation)
    return bool(len(turns) > BLENDED and turns[0] < REST and turns[BLENDED] > 2 * turns[0])


def is_blended(animation: Animation) -> bool:
    """Returns whether the frames after the T-pose are drawn towards it."""
    turns = _turns(animation)
    return bool(turns[1] < BLENDS * turns[BLENDED])


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


def held_t_pose(joints: Float[np.ndarray, "frames joints 3"]) -> Bool[np.ndarray, " frames"]:
    """Returns in which frames a performer stands with both arms stretched out to the sides.

    Captures often begin and end so, for calibration.

    Args:
        joints: HumanML3D's joints.
    """
    at = HUMANML3D.names.index
    across = unit(joints[:, at("left_shoulder")] - joints[:, at("right_shoulder")])
    held = np.ones(len(joints), bool)
    for side, sign in (("left", 1), ("right", -1)):
        shoulder, elbow, wrist, hip, ankle = (
            joints[:, at(f"{side}_{name}")]
            for name in ("shoulder", "elbow", "wrist", "hip", "ankle")
        )
        upper, lower = unit(elbow - shoulder), unit(wrist - elbow)
        held &= np.sum(upper * lower, axis=-1) > np.cos(np.radians(35))
        held &= np.abs(unit(wrist - shoulder)[:, 1]) < np.sin(np.radians(30))
        held &= sign * np.sum(unit(wrist - shoulder) * across, axis=-1) > np.cos(np.radians(40))
        held &= unit(hip - ankle)[:, 1] > np.cos(np.radians(20))
    return held


def _turns(animation: Animation) -> Float[np.ndarray, " frames"]:
    """Returns how far the joints are turned from the rest pose in the first frames, degrees."""
    rotations = animation.rotations[: BLENDED + 1]
    cosines = (np.trace(rotations, axis1=-2, axis2=-1) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean(axis=1)


def _with_bones_of(
    model: Float[np.ndarray, "joints 3"], joints: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, "frames joints 3"]:
    """Gives poses the bone lengths of another one, by moving joints along their bones."""
    placed = joints.copy()
    for joint, parent in list(enumerate(HUMANML3D.parents))[1:]:
        bone = joints[:, joint] - joints[:, parent]
        length = np.linalg.norm(model[joint] - model[parent])
        placed[:, joint] = placed[:, parent] + length * unit(bone)
    return placed
