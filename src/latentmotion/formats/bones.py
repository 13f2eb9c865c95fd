"""Bones with rest rotations, as files have them, to and from skeletons whose rest has none.

Reading. With W the rotation of a joint in the world and W₀ the same at rest, its rotation away
from rest, in world axes, is D = W W₀ᵀ. With positions p, all scales included, an `Animation` has

    rotation  R = D_parentᵀ D        offset  o = p₀ − p₀_parent        p = p_parent + D_parent o

Writing. Our skeletons have no rest rotations: in rest pose all are the identity. Programs draw a
bone from its joint along the joint's own y, so in files the joint j rests with the axes B_j:

    rotation in the file   B_pᵀ R_j B_j        offset in the file   B_pᵀ o_j        (p its parent)

x is the normal of the plane in which knees and elbows bend.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import cross, unit
from latentmotion.errors import FileFormatError
from latentmotion.kinematics.skeleton import Animation, Skeleton, posed
from latentmotion.storage.limits import MOST_FRAMES

_AHEAD, _UP = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)

# Rates that keys can have been sampled at; others are those of keys set by hand.
_LEAST_FPS, _MOST_FPS = 8.0, 1000.0


@dataclass(frozen=True, eq=False)
class WorldPose:
    """Positions and rotations of joints in the world, over time or of one pose."""

    positions: Float[np.ndarray, "... joints 3"]  # Meters, y up.
    rotations: Float[np.ndarray, "... joints 3 3"]  # Rotations in the world.


# A bone in the world: its position, its rotation, and its matrix with all scales.
Frame = tuple[np.ndarray, np.ndarray, np.ndarray]


def placed(
    parent: Frame, translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray
) -> Frame:
    """Returns the frame of a bone that is moved, turned and scaled relative to its parent's."""
    position, turned, linear = parent
    return (
        position + np.einsum("...ab,...b->...a", linear, translation),
        turned @ rotation,
        linear @ (rotation * scale[..., None, :]),
    )


def matrix_of(frame: Frame) -> Float[np.ndarray, "4 4"]:
    """Returns the matrix of a bone's frame."""
    matrix = np.eye(4)
    matrix[:3, 3], _, matrix[:3, :3] = frame
    return matrix


def plain_skeleton(
    name: str, names: Sequence[str], parents: Sequence[int], rest: WorldPose
) -> Skeleton:
    """Returns the skeleton of a rest pose in the world; repeated names get a number."""
    offsets = rest.positions - rest.positions[[max(parent, 0) for parent in parents]]
    # Files may repeat a name; joints are looked up by theirs.
    counts: dict[str, int] = {}
    distinct = []
    for joint in names:
        counts[joint] = counts.get(joint, 0) + 1
        distinct.append(joint if counts[joint] == 1 else f"{joint}_{counts[joint]}")
    return Skeleton(name, tuple(distinct), tuple(parents), offsets)


def plain_animation(skeleton: Skeleton, rest: WorldPose, moved: WorldPose, fps: float) -> Animation:
    """Returns the animation of `plain_skeleton`; translations only where joints move apart."""
    world = moved.rotations @ np.swapaxes(rest.rotations, -1, -2)
    return posed(skeleton, world, moved.positions, fps)


def even_rate(
    path: str | Path, seconds: Float[np.ndarray, " keys"], otherwise: float = 30.0
) -> tuple[float, Float[np.ndarray, " frames"]]:
    """Returns the frame rate on which all keys fall, or another, and the time of each frame.

    Args:
        path: The file, for the error.
        seconds: Times of keys, rising.
        otherwise: Frames per second where the keys lie unevenly or far apart.

    Raises:
        FileFormatError: The keys span more than `MOST_FRAMES`, and more frames than there are keys.
    """
    if not len(seconds):
        return otherwise, np.zeros(1)
    fps, length = otherwise, float(seconds[-1] - seconds[0])
    steps = np.diff(seconds)
    steps = steps[steps > 0.5 / _MOST_FPS]
    if len(steps):
        rate = max(round(length / float(np.median(steps))), 1) / length
        whole = float(round(rate))
        rate = whole if whole and abs(rate - whole) < 2e-4 * rate else rate
        frames = (seconds - seconds[0]) * rate
        # Times in files are rounded: 2 % of a frame is their error, more is another rate.
        even = np.abs(frames - np.round(frames)).max() < 0.02
        fps = rate if even and _LEAST_FPS <= rate <= _MOST_FPS else fps
    if length * fps > max(MOST_FRAMES, len(seconds)):
        raise FileFormatError(
            path,
            f"has keys from {seconds[0]:g} s to {seconds[-1]:g} s, {length * fps:.3g} frames at "
            f"{fps:g} fps; expected at most {MOST_FRAMES:,}: cut the animation or repair its times",
        )
    return fps, seconds[0] + np.arange(round(length * fps) + 1) / fps


@dataclass(frozen=True, eq=False)
class BoneAxes:
    """The axes of all joints in rest pose, and the change of basis that they imply."""

    skeleton: Skeleton  # The skeleton with these joints.
    # Axes of each joint, in the columns; y points to the next joint.
    world: Float[np.ndarray, "joints 3 3"]

    @property
    def above(self) -> Float[np.ndarray, "joints 3 3"]:
        """Axes of each joint's parent; the world's for the root."""
        parents = list(self.skeleton.parents)
        return np.concatenate([self.world, np.eye(3)[None]])[parents]

    def rotations(
        self, rotations: Float[np.ndarray, "*frames joints 3 3"]
    ) -> Float[np.ndarray, "*frames joints 3 3"]:
        """Returns local rotations in the file's axes, which include the rest pose."""
        return np.swapaxes(self.above, -1, -2) @ rotations @ self.world

    def offsets(
        self, offsets: Float[np.ndarray, "*frames joints 3"]
    ) -> Float[np.ndarray, "*frames joints 3"]:
        """Returns offsets from the parents in the parents' axes."""
        return np.einsum("jba,...jb->...ja", self.above, offsets)


def bone_axes(skeleton: Skeleton, miss: float = 0.0) -> BoneAxes:
    """Chooses each joint's axes: y points to its middle child; tips keep their parent's axes.

    Toes lie level, so that no bone sticks in the floor.

    Args:
        skeleton: The joints.
        miss: Meters by which bones pass the joint that they point to, for programs that connect
            bones which meet.
    """
    bones, offsets = {}, np.asarray(skeleton.offsets, float)
    lengths = np.linalg.norm(offsets, axis=-1)
    aside = np.abs(offsets[:, 0]) / np.maximum(lengths, 1e-12)
    for joint in reversed(range(1, len(skeleton))):  # the first of equals is kept
        parent = skeleton.parents[joint]
        if lengths[joint] > 1e-6 and aside[joint] <= aside[bones.get(parent, joint)]:
            bones[parent] = joint  # from pelvis and chest to the spine, not to a limb
    world = np.tile(np.eye(3), (len(skeleton), 1, 1))
    if bones:
        aims = offsets[list(bones.values())]
        world[list(bones)] = _frames(aims + miss * _frames(aims)[..., 0])
    level = _frames(np.array(_AHEAD))
    for joint, parent in enumerate(skeleton.parents):
        if joint not in bones and parent >= 0:
            world[joint] = level if world[parent, 2, 1] > 0.8 else world[parent]
    return BoneAxes(skeleton, world)


def _frames(y: Float[np.ndarray, "*bones 3"]) -> Float[np.ndarray, "*bones 3 3"]:
    """Returns axes with the given y whose z points ahead, or up where y itself points ahead."""
    y = unit(y)
    x = unit(cross(y, np.where(np.abs(y[..., 2:]) > 0.8, _UP, _AHEAD)))
    return np.stack([x, y, cross(x, y)], axis=-1)
