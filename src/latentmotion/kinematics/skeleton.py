"""Skeletons: names, parents, offsets; forward kinematics; rotations of their joints over time.

Axes are right-handed with y up; a body in rest pose faces +z, its left side is +x. Meters.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
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

BatchedJoints = Float[np.ndarray, "frames *batch joints 3"]  # Those of motions of one length.

Joints = Float[np.ndarray, "frames joints 3"]  # Global positions of the joints of a body, meters.


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

    @cached_property
    def lines(self) -> tuple[tuple[int, ...], ...]:
        """For each joint itself, its parent and so on up to the root."""
        lines: list[tuple[int, ...]] = []
        for joint, parent in enumerate(self.parents):
            lines.append((joint, *(lines[parent] if parent >= 0 else ())))
        return tuple(lines)

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


# Plain text, which is read at every start: TOML would take 4 ms.
_SHIPPED = [
    row.split()
    for row in Path(__file__).with_name("skeletons.txt").read_text(encoding="utf-8").splitlines()
    if row and not row.startswith("#")
]


def _shipped(
    skeleton: str, sole: str = "ankle", signs: tuple[int, int, int] = (1, 1, 1)
) -> tuple[Skeleton, Float[np.ndarray, "joints 3"]]:
    """Returns a skeleton of `skeletons.txt`, and the directions of its bones there."""
    rows = [row[1:] for row in _SHIPPED if row[0] == skeleton]
    names = tuple(row[0] for row in rows)
    parents = tuple(names.index(row[1]) if row[1] in names else -1 for row in rows)
    left, right = (
        tuple(names.index(f"{side}_{joint}") for joint in (sole, "foot"))
        for side in ("left", "right")
    )
    directions = np.array([row[2:5] for row in rows], dtype=np.float64)
    offsets = directions * np.array([row[5:] for row in rows], dtype=np.float64) * signs
    return Skeleton(skeleton, names, parents, offsets, left, right), directions


_HUMANML3D, _HANDS, _KIT = (
    _shipped("humanml3d"),
    _shipped("hands"),
    _shipped("kit", "heel", (-1, 1, 1)),
)

# The 22 body joints of SMPL as HumanML3D orders them, with its canonical bone lengths.
HUMANML3D = _HUMANML3D[0]

HANDS = _HANDS[0]  # HumanML3D's body with the 30 finger joints of SMPL-H.

KIT = _KIT[0]  # The 21 joints of KIT-ML's Master Motor Map.

# Directions of bones from which inverse kinematics measures rotations.
HUMANML3D_DIRECTIONS, HANDS_DIRECTIONS, KIT_DIRECTIONS = _HUMANML3D[1], _HANDS[1], _KIT[1]

# A body of 1.7 m in a T-pose with the 24 joints that SMPL's poses turn, in their order.
BODY = _shipped("body")[0]


MOST_FPS = 1000.0  # Frames per second above which a rate is taken for a mistake.


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
    translations: Joints | None = None
    """Animated offsets in place of the skeleton's, in files that move more than the root."""

    def __len__(self) -> int:
        return len(self.rotations)

    @classmethod
    def at_rest(cls, skeleton: Skeleton) -> Animation:
        """Returns the rest pose as one frame, the root at the origin."""
        return cls(skeleton, np.tile(np.eye(3), (1, len(skeleton), 1, 1)), np.zeros((1, 3)), 20.0)

    def joints(self) -> Joints:
        """Returns global joint positions, meters."""
        return self.skeleton.forward_kinematics(
            self.rotations, self.root_positions, self.translations
        )

    def picked(self, frames: slice | np.ndarray) -> Animation:
        """Returns some of its frames, at the same rate."""
        translations = None if self.translations is None else self.translations[frames]
        rotations, root_positions = self.rotations[frames], self.root_positions[frames]
        return Animation(self.skeleton, rotations, root_positions, self.fps, translations)

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
    joints: Joints,
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
) -> Joints:
    """Returns the joints of a root and of the bones from each parent to the next joint, meters."""
    joints = [root]
    for bone, parent in enumerate(skeleton.parents[1:]):
        joints.append(joints[parent] + bones[:, bone])
    return np.stack(joints, axis=1)


# Meters up to which a joint counts as staying where its parent carries it.
_STILL = 1e-5


def check_fps(fps: float) -> None:
    """Raises InputError for a number that is no frame rate."""
    if not (np.isfinite(fps) and 0 < fps <= MOST_FPS):
        raise InputError(f"fps is {fps}, expected a positive number up to {MOST_FPS:g}")


def _between(
    track: np.ndarray, before: np.ndarray, after: np.ndarray, share: np.ndarray
) -> np.ndarray:
    return track[before] * (1 - share) + track[after] * share


def interpolate(joints: Joints, step: float) -> Float[np.ndarray, "times joints 3"]:
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
