"""Bones as files have them, turned at rest, and as skeletons here have them, with plain rests.

Reading. With W the rotation of a joint in the world and W₀ the same at rest, its rotation in the
world's axes is D = W W₀ᵀ. What an `Animation` holds follows from that and the positions p, all
scales in them:

    rotation  R = D_parentᵀ D        offset  o = p₀ − p₀_parent        p = p_parent + D_parent o

Writing. A skeleton here has no axes: in rest pose all rotations are the identity. Programs draw a
bone from its joint along the joint's own y, so in files the joint j rests with the axes B_j, and

    rotation in the file   B_pᵀ R_j B_j        offset in the file   B_pᵀ o_j        (p its parent)

x is normal to the plane in which knees and elbows bend.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.skeleton import Skeleton

_AHEAD, _UP = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)

_STILL = 1e-5
"""Meters up to which a joint counts as staying where its parent carries it."""


@dataclass(frozen=True, eq=False)
class WorldPose:
    """Where joints are and how they are turned in the world, over time or once."""

    positions: Float[np.ndarray, "... joints 3"]
    """Meters, y up."""
    turns: Float[np.ndarray, "... joints 3 3"]
    """Rotations."""


def plain_skeleton(
    name: str, names: Sequence[str], parents: Sequence[int], rest: WorldPose
) -> Skeleton:
    """Returns bones as they lie in the world at rest; names that come up again are numbered."""
    offsets = rest.positions - rest.positions[[max(parent, 0) for parent in parents]]
    return Skeleton(name, _distinct(names), tuple(parents), offsets)


def plain_animation(skeleton: Skeleton, rest: WorldPose, moved: WorldPose, fps: float) -> Animation:
    """Returns how `plain_skeleton`'s joints turn, and move if they do more than turn."""
    world = moved.turns @ np.swapaxes(rest.turns, -1, -2)
    inner = list(skeleton.parents[1:])
    rotations, places = world.copy(), np.zeros_like(moved.positions)
    rotations[:, 1:] = np.swapaxes(world[:, inner], -1, -2) @ world[:, 1:]
    steps = moved.positions[:, 1:] - moved.positions[:, inner]
    places[:, 1:] = np.einsum("tjab,tja->tjb", world[:, inner], steps)
    moves = np.abs(places - skeleton.offsets).max() > _STILL
    track = places if moves else None
    return Animation(skeleton, rotations, moved.positions[:, 0].copy(), fps, track)


def even_rate(
    seconds: Float[np.ndarray, " keys"], otherwise: float = 30.0
) -> tuple[float, Float[np.ndarray, " frames"]]:
    """Returns the frame rate on which all keys fall, or another, and the time of each frame.

    Args:
        seconds: Times of keys, rising.
        otherwise: Frames per second where the keys lie unevenly or far apart.
    """
    if not len(seconds):
        return otherwise, np.zeros(1)
    fps = _rate(seconds) or otherwise
    count = round(float(seconds[-1] - seconds[0]) * fps) + 1
    return fps, seconds[0] + np.arange(count) / fps


def _rate(keys: Float[np.ndarray, " keys"]) -> float | None:
    """Returns the rate of evenly laid keys, a whole number where it is near one."""
    steps = np.diff(keys)
    steps = steps[steps > 0.5 / _MOST_FPS]
    if not len(steps):
        return None
    length = float(keys[-1] - keys[0])
    fps = max(round(length / float(np.median(steps))), 1) / length
    whole = float(round(fps))
    fps = whole if whole and abs(fps - whole) < 2e-4 * fps else fps
    places = (keys - keys[0]) * fps
    even = np.abs(places - np.round(places)).max() < 0.02
    return fps if even and _LEAST_FPS <= fps <= _MOST_FPS else None


_LEAST_FPS, _MOST_FPS = 8.0, 1000.0
"""Rates that keys can have been sampled at; others are those of keys set by hand."""


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    seen: dict[str, int] = {}
    distinct = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        distinct.append(name if seen[name] == 1 else f"{name}_{seen[name]}")
    return tuple(distinct)


@dataclass(frozen=True, eq=False)
class BoneAxes:
    """The axes of all joints in rest pose, and what they make of rotations and offsets."""

    skeleton: Skeleton
    """Whose joints they are."""
    world: Float[np.ndarray, "joints 3 3"]
    """Axes of each joint in its columns; y points to the next joint."""

    @property
    def above(self) -> Float[np.ndarray, "joints 3 3"]:
        """Axes of each joint's parent; the world's for the root."""
        parents = list(self.skeleton.parents)
        axes = np.concatenate([self.world, np.eye(3)[None]])
        return axes[parents]

    def rotations(
        self, rotations: Float[np.ndarray, "*frames joints 3 3"]
    ) -> Float[np.ndarray, "*frames joints 3 3"]:
        """Returns local rotations as a file has them, rest pose included."""
        return np.swapaxes(self.above, -1, -2) @ rotations @ self.world

    def offsets(
        self, offsets: Float[np.ndarray, "*frames joints 3"]
    ) -> Float[np.ndarray, "*frames joints 3"]:
        """Returns places relative to the parents in the parents' axes."""
        return np.einsum("jba,...jb->...ja", self.above, offsets)


def bone_axes(skeleton: Skeleton, miss: float = 0.0) -> BoneAxes:
    """Lays each joint's axes: y to its child in the middle; tips go on as their parents do.

    Toes lie level, so that no bone sticks in the floor.

    Args:
        skeleton: Whose joints they are.
        miss: Meters by which bones pass the joint that they point to, for programs that would
            tie together what meets.
    """
    world = np.tile(np.eye(3), (len(skeleton), 1, 1))
    for joint, parent in enumerate(skeleton.parents):
        bone = _bone(skeleton, joint)
        if bone is not None:
            world[joint] = _frame(bone + miss * _frame(bone)[:, 0])
        elif parent >= 0:
            ahead = world[parent, 2, 1] > 0.8
            world[joint] = _frame(np.array(_AHEAD)) if ahead else world[parent]
    return BoneAxes(skeleton, world)


def _bone(skeleton: Skeleton, joint: int) -> Float[np.ndarray, " 3"] | None:
    """Returns the way to the next joint: from pelvis and chest to the spine, not to a limb."""
    bones = [np.asarray(skeleton.offsets[child], float) for child in skeleton.children(joint)]
    bones = [bone for bone in bones if np.linalg.norm(bone) > 1e-6]
    return min(bones, key=lambda bone: abs(bone[0]) / np.linalg.norm(bone), default=None)


def _frame(y: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Returns the axes with y this way whose z looks ahead, or up where y itself looks ahead."""
    y = y / np.linalg.norm(y)
    x = np.cross(y, _UP if abs(y[2]) > 0.8 else _AHEAD)
    x /= np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)], axis=-1)
