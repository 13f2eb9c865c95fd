"""Looks: the head is turned so that the eyes look at a point.

Positions of joints do not show how a head is turned. So they stay, and the motion gets an animation
whose head turns, which every writer of files follows. The head turns from the neck's direction by a
yaw and a pitch that come and go as offsets of joints do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from latentmotion.control.exact import BLEND, spread
from latentmotion.control.goals import LookAt, span_of
from latentmotion.errors import InputError
from latentmotion.kinematics.humanoid import Humanoid
from latentmotion.kinematics.recorded import Recorded
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.motion import Motion

# Meters from the head's joint to between the eyes, in the head's axes.
_EYES = np.array([0.0, 0.07, 0.09])

# Yaw and pitch up to which neck and head turn together.
_FARTHEST = np.radians([80.0, 60.0])

# Rounds in which the place of the eyes and the direction of the head settle.
_ROUNDS = 6


def looking(motion: Motion, looks: Sequence[LookAt]) -> Motion:
    """Returns the motion with a head that turns to points; the positions of joints are the same.

    Args:
        motion: A motion of a skeleton with a head.
        looks: Where the eyes look, and when.

    Raises:
        InputError: Two looks are at one time.
    """
    animation, skeleton = motion.animation(), motion.skeleton
    head = skeleton.names.index("head")
    world = skeleton.world_rotations(animation.rotations)
    angles: dict[int, np.ndarray] = {}
    for look in looks:
        first, last = span_of(look, len(motion), motion.fps)
        for frame in range(first, last + 1):
            if frame in angles:
                raise InputError(f"two looks at {frame / motion.fps:g} s: leave one out")
            place = motion.joints[frame, head].astype(np.float64)
            angles[frame] = np.append(_toward(np.array(look.to), place, world[frame, head]), 0.0)
    yaw, pitch, _ = spread(angles, len(motion), BLEND * motion.fps).T
    world[:, head] = world[:, head] @ _turned(yaw, pitch)
    turned = replace(animation, rotations=skeleton.local_rotations(world))
    names = {name: joint for joint, name in enumerate(skeleton.names)}
    body = Humanoid(animation.skeleton, names)
    return replace(motion).with_recorded(Recorded(turned, body))


def missed_looks(motion: Motion, look: LookAt) -> float:
    """Returns by how many degrees the eyes look past a point, the most while the look holds."""
    head = motion.skeleton.names.index("head")
    world = motion.skeleton.world_rotations(motion.animation().rotations)[:, head]
    first, last = span_of(look, len(motion), motion.fps)
    frames = slice(first, last + 1)
    eyes = motion.joints[frames, head] + world[frames] @ _EYES
    way = np.array(look.to) - eyes
    along = (world[frames, :, 2] * way).sum(axis=-1) / np.linalg.norm(way, axis=-1)
    return float(np.degrees(np.arccos(np.clip(along, -1, 1)).max()))


def _toward(
    to: Float[np.ndarray, " 3"], place: Float[np.ndarray, " 3"], axes: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, " 2"]:
    """Returns yaw and pitch by which a head turns for its eyes to look at a point, radians."""
    angles = np.zeros(2)
    for _ in range(_ROUNDS):
        way = axes.T @ (to - place) - _turned(angles[0:1], angles[1:2])[0] @ _EYES
        goal = np.array([np.arctan2(way[0], way[2]), np.arctan2(way[1], np.hypot(way[0], way[2]))])
        angles = np.clip(goal, -_FARTHEST, _FARTHEST)
    return angles


def _turned(
    yaw: Float[np.ndarray, "*batch"], pitch: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 3 3"]:
    """Returns the rotations by a yaw toward the left, then a pitch upward."""
    about_y, about_x = (np.zeros((*np.shape(yaw), 3)) for _ in range(2))
    about_y[..., 1], about_x[..., 0] = yaw, -np.asarray(pitch)
    return matrix_from_axis_angle(about_y) @ matrix_from_axis_angle(about_x)
