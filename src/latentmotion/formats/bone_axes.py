"""Bone axes: a frame for each joint whose y runs along the bone, as animation programs lay bones.

A skeleton of ours has no axes: in rest pose all rotations are the identity. Programs draw a bone
from its joint along the joint's own y, so in files the joint j rests with the axes B_j, and

    rotation in the file   B_pᵀ R_j B_j        offset in the file   B_pᵀ o_j        (p its parent)

x is normal to the plane in which knees and elbows bend.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.skeleton import Skeleton

_AHEAD, _UP = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)


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
