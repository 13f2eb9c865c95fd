"""Skeletons: names, parents, offsets; forward kinematics; rotations of their joints over time.

Axes are right-handed with y up; a body in rest pose faces +z, its left side is +x. Meters.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.errors import InputError
from latentmotion.kinematics.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from latentmotion.storage.limits import (
    MOST_DEPTH,
    MOST_FRAMES,
    MOST_JOINTS,
    MOST_NAMES,
    UNPACKED_FACTOR,
)


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of joints in rest pose. A parent always comes before its children.

    Raises:
        InputError: They are no such tree, are too many or too deep, or an offset is not finite.
    """

    name: str
    """Its name, e.g. `humanml3d`."""
    names: tuple[str, ...]
    """One name per joint."""
    parents: tuple[int, ...]
    """Index of each joint's parent; -1 for the root, which is joint 0."""
    offsets: Float[np.ndarray, "joints 3"]
    """Rest position of each joint relative to its parent, meters; the root's is zero."""
    left_foot: tuple[int, ...] = ()
    """Joints of the left foot that touch the floor (ankle, toe)."""
    right_foot: tuple[int, ...] = ()
    """Joints of the right foot that touch the floor (ankle, toe)."""
    end_sites: tuple[int, ...] = ()
    """Joints that are only tips of bones (BVH's `End Site`) and never rotate."""

    def __post_init__(self) -> None:
        count = len(self.names)
        if not 0 < count <= MOST_JOINTS:
            raise InputError(f"a skeleton of {count:,} joints, expected 1 to {MOST_JOINTS:,}")
        letters = sum(map(len, self.names))
        if letters > MOST_NAMES:
            raise InputError(f"joints with names of {letters:,} letters, expected {MOST_NAMES:,}")
        if len(self.parents) != count or np.shape(self.offsets) != (count, 3):
            sizes = f"{len(self.parents)} parents and offsets of shape {np.shape(self.offsets)}"
            raise InputError(f"a skeleton of {count} joints with {sizes}")
        depths = [0]
        for joint, parent in enumerate(self.parents):
            if not (0 <= parent < joint if joint else parent == -1):
                raise InputError(f"joint {joint} has the parent {parent}, expected one before it")
            if joint:
                depths.append(depths[parent] + 1)
        if max(depths) >= MOST_DEPTH:
            raise InputError(
                f"a chain of {max(depths) + 1:,} joints, expected at most {MOST_DEPTH}"
            )
        if not np.isfinite(self.offsets).all():
            raise InputError("a skeleton with offsets that are not finite")

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        return f"Skeleton({self.name!r}, {len(self)} joints)"

    @property
    def mirror(self) -> tuple[int, ...]:
        """For each joint the index of its counterpart on the other side, by name."""
        other = {"left": "right", "right": "left"}
        mirrored = [re.sub("^(left|right)", lambda m: other[m[0]], name) for name in self.names]
        return tuple(self.names.index(name) for name in mirrored)

    def children(self, joint: int) -> tuple[int, ...]:
        """Returns the joints whose parent is `joint`."""
        return tuple(j for j, parent in enumerate(self.parents) if parent == joint)

    def rest_joints(self) -> Float[np.ndarray, "joints 3"]:
        """Returns the joint positions of the rest pose, the root at the origin."""
        joints = np.array(self.offsets, dtype=np.float64)
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                joints[joint] += joints[parent]
        return joints

    def world_rotations(
        self, rotations: Float[np.ndarray, "*batch joints 3 3"]
    ) -> Float[np.ndarray, "*batch joints 3 3"]:
        """Converts rotations relative to the parents to rotations in the world, float64."""
        world = np.array(rotations, dtype=np.float64)
        for joint, parent in list(enumerate(self.parents))[1:]:
            world[..., joint, :, :] = world[..., parent, :, :] @ rotations[..., joint, :, :]
        return world

    def local_rotations(
        self, world: Float[np.ndarray, "*batch joints 3 3"]
    ) -> Float[np.ndarray, "*batch joints 3 3"]:
        """Converts rotations in the world to rotations relative to the parents."""
        above = world[..., list(self.parents[1:]), :, :]
        local = world.copy()
        local[..., 1:, :, :] = np.swapaxes(above, -1, -2) @ world[..., 1:, :, :]
        return local

    def forward_kinematics(
        self,
        rotations: Float[Any, "*batch joints 3 3"],
        root_positions: Float[Any, "*batch 3"],
        translations: Float[Any, "*batch joints 3"] | None = None,
    ) -> Float[Any, "*batch joints 3"]:
        """Computes joint positions from local rotations.

        Args:
            rotations: Rotation of each joint relative to its parent; identity is the rest pose.
            root_positions: Position of the root, meters.
            translations: Animated offsets that replace the rest offsets, where a file has them.

        Returns:
            Global joint positions, meters.
        """
        xp = array_namespace(rotations, root_positions)
        offsets = xp.asarray(self.offsets, dtype=rotations.dtype, device=device(rotations))
        world, positions = [rotations[..., 0, :, :]], [root_positions]
        for joint, parent in list(enumerate(self.parents))[1:]:
            offset = offsets[joint] if translations is None else translations[..., joint, :]
            step = xp.sum(world[parent] * offset[..., None, :], axis=-1)
            positions.append(positions[parent] + step)
            world.append(xp.matmul(world[parent], rotations[..., joint, :, :]))
        return xp.stack(positions, axis=-2)


def _from_lengths(
    directions: list[tuple[int, int, int]], lengths: list[float]
) -> Float[np.ndarray, "joints 3"]:
    return np.array(directions, dtype=np.float64) * np.array(lengths)[:, None]


_RIGHT, _LEFT, _UP, _DOWN, _AHEAD = (-1, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)

HUMANML3D_DIRECTIONS = [
    *((0, 0, 0), _LEFT, _RIGHT, _UP, _DOWN, _DOWN, _UP, _DOWN, _DOWN, _UP, _AHEAD, _AHEAD),
    *(_UP, _LEFT, _RIGHT, _AHEAD, _DOWN, _DOWN, _DOWN, _DOWN, _DOWN, _DOWN),
]
"""Bone directions from which HumanML3D's inverse kinematics measures rotations."""

HUMANML3D_LENGTHS = [
    *(0.0, 0.1031, 0.1099, 0.1316, 0.3936, 0.3902, 0.1432, 0.4324, 0.4256, 0.0574, 0.1434),
    *(0.1494, 0.2194, 0.1375, 0.1434, 0.1030, 0.1316, 0.1230, 0.2568, 0.2631, 0.2660, 0.2699),
]
"""Canonical bone lengths of HumanML3D, meters."""

HUMANML3D = Skeleton(
    name="humanml3d",
    names=(
        *("pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2"),
        *("left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck"),
        *("left_collar", "right_collar", "head", "left_shoulder", "right_shoulder"),
        *("left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    ),
    parents=(-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19),
    offsets=_from_lengths(HUMANML3D_DIRECTIONS, HUMANML3D_LENGTHS),
    left_foot=(7, 10),
    right_foot=(8, 11),
)
"""The 22 body joints of SMPL as HumanML3D orders them."""

_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
"""Fingers in the order of SMPL-H, three joints each."""

_FINGER_NAMES = tuple(f"{finger}{n}" for finger in _FINGERS for n in (1, 2, 3))
_FINGER_LENGTHS = [0.1, 0.035, 0.025]

HANDS_DIRECTIONS = [
    *HUMANML3D_DIRECTIONS,
    *((_AHEAD if name.startswith("thumb") else _DOWN) for name in _FINGER_NAMES * 2),
]
"""Bone directions from which rotations of a body with fingers are measured."""

HANDS = Skeleton(
    name="hands",
    names=(
        *HUMANML3D.names,
        *(f"{side}_{name}" for side in ("left", "right") for name in _FINGER_NAMES),
    ),
    parents=(
        *HUMANML3D.parents,
        *(
            wrist if n % 3 == 0 else len(HUMANML3D.names) + 15 * hand + n - 1
            for hand, wrist in enumerate((20, 21))
            for n in range(15)
        ),
    ),
    offsets=_from_lengths(HANDS_DIRECTIONS, [*HUMANML3D_LENGTHS, *_FINGER_LENGTHS * 10]),
    left_foot=(7, 10),
    right_foot=(8, 11),
)
"""HumanML3D's body with the 30 finger joints of SMPL-H; lengths of fingers are round figures."""

KIT_DIRECTIONS = [
    *((0, 0, 0), _UP, _UP, _UP, _UP, _LEFT, _DOWN, _DOWN, _RIGHT, _DOWN, _DOWN),
    *(_LEFT, _DOWN, _DOWN, _AHEAD, _AHEAD, _RIGHT, _DOWN, _DOWN, _AHEAD, _AHEAD),
]
"""Bone directions from which KIT's inverse kinematics measures rotations."""

KIT_LENGTHS = [
    *(0.0, 0.07, 0.14, 0.28, 0.13, 0.22, 0.32, 0.25, 0.22, 0.32, 0.25),
    *(0.16, 0.42, 0.42, 0.05, 0.15, 0.16, 0.42, 0.42, 0.05, 0.15),
]
"""Bone lengths of a body of 1.7 m, after Winter's proportions (thigh and shank 0.245 of height...).

KIT's own sample body is not at hand; features do not depend on these unless one retargets.
"""

KIT = Skeleton(
    name="kit",
    names=(
        *("pelvis", "spine1", "spine2", "neck", "head"),
        *("right_shoulder", "right_elbow", "right_wrist"),
        *("left_shoulder", "left_elbow", "left_wrist"),
        *("right_hip", "right_knee", "right_ankle", "right_heel", "right_foot"),
        *("left_hip", "left_knee", "left_ankle", "left_heel", "left_foot"),
    ),
    parents=(-1, 0, 1, 2, 3, 3, 5, 6, 3, 8, 9, 0, 11, 12, 13, 14, 0, 16, 17, 18, 19),
    offsets=_from_lengths(KIT_DIRECTIONS, KIT_LENGTHS) * (-1, 1, 1),
    left_foot=(19, 20),
    right_foot=(14, 15),
)
"""The 21 joints of KIT-ML's Master Motor Map; sides as the published features have them.

Their inverse kinematics takes the right hip and shoulder to point to +x, so x is negated here.
"""

_SIDE = {
    **{"hip": (0.08, -0.09, 0.0), "knee": (0.03, -0.41, 0.0), "ankle": (0.0, -0.41, -0.02)},
    **{"foot": (0.02, -0.06, 0.13), "collar": (0.08, 0.12, 0.0), "shoulder": (0.11, 0.02, 0.0)},
    **{"elbow": (0.28, 0.0, 0.0), "wrist": (0.25, 0.0, 0.0), "hand": (0.08, 0.0, 0.0)},
}
_MIDDLE = {
    **{"pelvis": (0.0, 0.0, 0.0), "spine1": (0.0, 0.12, -0.01), "spine2": (0.0, 0.13, 0.01)},
    **{"spine3": (0.0, 0.06, 0.01), "neck": (0.0, 0.21, -0.02), "head": (0.0, 0.11, 0.04)},
}


def _rest_offset(name: str) -> tuple[float, float, float]:
    side, _, joint = name.partition("_")
    x, y, z = _MIDDLE[name] if name in _MIDDLE else _SIDE[joint]
    return (-x if side == "right" else x, y, z)


_BODY_NAMES = (*HUMANML3D.names, "left_hand", "right_hand")

BODY = Skeleton(
    name="body",
    names=_BODY_NAMES,
    parents=(*HUMANML3D.parents, 20, 21),
    offsets=np.array([_rest_offset(name) for name in _BODY_NAMES]),
    left_foot=(7, 10),
    right_foot=(8, 11),
)
"""A body of 1.7 m in a T-pose with the 24 joints that SMPL's poses turn, in their order.

Lengths are round figures after Winter's proportions, and owe nothing to SMPL's files.
"""


MOST_FPS = 1000.0
"""Frames per second above which a rate is taken for a mistake."""


@dataclass(frozen=True, eq=False)
class Animation:
    """Local rotations of a skeleton over time."""

    skeleton: Skeleton
    """The skeleton with these joints."""
    rotations: Float[np.ndarray, "frames joints 3 3"]
    """Rotation of each joint relative to its parent; identity is the rest pose."""
    root_positions: Float[np.ndarray, "frames 3"]
    """Position of the root joint, meters, y up."""
    fps: float
    """Frames per second."""
    translations: Float[np.ndarray, "frames joints 3"] | None = None
    """Animated offsets in place of the skeleton's, in files that move more than the root."""

    def __len__(self) -> int:
        return len(self.rotations)

    @classmethod
    def at_rest(cls, skeleton: Skeleton) -> Animation:
        """Returns the rest pose as one frame, the root at the origin."""
        return cls(skeleton, np.tile(np.eye(3), (1, len(skeleton), 1, 1)), np.zeros((1, 3)), 20.0)

    def joints(self) -> Float[np.ndarray, "frames joints 3"]:
        """Returns global joint positions, meters."""
        return self.skeleton.forward_kinematics(
            self.rotations, self.root_positions, self.translations
        )

    def resampled(self, fps: float) -> Animation:
        """Returns the animation at another frame rate: frame i is the pose at i / fps seconds.

        Rotations are interpolated by great arcs, so that bones keep their lengths, positions by
        straight lines. The last frame is kept if it falls on the new rate.

        Args:
            fps: Frames per second wanted.

        Raises:
            InputError: `fps` is not a positive number, or far too large.
        """
        check_fps(fps)
        last = len(self) - 1
        if last * fps / self.fps > max(MOST_FRAMES, UNPACKED_FACTOR * last):
            problem = f"{last * fps / self.fps:,.0f} frames from {last + 1:,}"
            raise InputError(f"{problem}; check the frame rates {self.fps:g} and {fps:g}")
        times = np.arange(int(last * fps / self.fps + 1e-6) + 1) * (self.fps / fps)
        before = np.minimum(times.astype(int), max(last - 1, 0))
        after, share = np.minimum(before + 1, last), np.minimum(times - before, 1.0)
        quaternions = quaternion_from_matrix(self.rotations)
        rotations = slerp(quaternions[before], quaternions[after], share[:, None])
        return Animation(
            skeleton=self.skeleton,
            rotations=matrix_from_quaternion(rotations),
            root_positions=_between(self.root_positions, before, after, share[:, None]),
            fps=float(fps),
            translations=None
            if self.translations is None
            else _between(self.translations, before, after, share[:, None, None]),
        )


def posed(
    skeleton: Skeleton,
    world: Float[np.ndarray, "frames joints 3 3"],
    joints: Float[np.ndarray, "frames joints 3"],
    fps: float,
    root: Float[np.ndarray, "frames 3"] | None = None,
) -> Animation:
    """Returns the animation of rotations and positions in the world.

    Args:
        skeleton: The joints.
        world: Their rotations in the world.
        joints: Their positions.
        fps: Frames per second.
        root: Positions of the root; by default those of joint 0.
    """
    parents = list(skeleton.parents[1:])
    translations = np.zeros_like(joints, dtype=np.float64)
    steps = joints[:, 1:] - joints[:, parents]
    translations[:, 1:] = np.einsum("tjab,tja->tjb", world[:, parents], steps)
    moves = np.abs(translations - skeleton.offsets)[:, 1:].max(initial=0.0) > _STILL
    return Animation(
        skeleton,
        skeleton.local_rotations(world),
        joints[:, 0] if root is None else root,
        fps,
        translations if moves else None,
    )


def joints_of_bones(
    root: Float[np.ndarray, "frames 3"],
    bones: Float[np.ndarray, "frames bones 3"],
    skeleton: Skeleton,
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns the joints of a root and of the bones from each parent to the next joint, meters."""
    joints = [root]
    for bone, parent in enumerate(skeleton.parents[1:]):
        joints.append(joints[parent] + bones[:, bone])
    return np.stack(joints, axis=1)


_STILL = 1e-5
"""Meters up to which a joint counts as staying where its parent carries it."""


def check_fps(fps: float) -> None:
    """Raises InputError for a number that is no frame rate."""
    if not (np.isfinite(fps) and 0 < fps <= MOST_FPS):
        raise InputError(f"fps is {fps}, expected a positive number up to {MOST_FPS:g}")


def _between(
    track: np.ndarray, before: np.ndarray, after: np.ndarray, share: np.ndarray
) -> np.ndarray:
    return track[before] * (1 - share) + track[after] * share
