"""A motion's joints on an armature's bones, whatever their axes, rest pose and unit.

With G the rotation of a joint from the motion's rest pose, A the rotation from the motion's axes to
the armature's, D that from the bone's rest direction to the joint's, and R the bone's own rest:

    rotation of the bone in the armature  =  A G Aᵀ · D · R
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from .bvh import BvhTake, write_rest

# Movement up to which a bone counts as still: meters, and entries of a rotation.
_STILL = 1e-5

# From the motion's axes (y up) to Blender's (z up).
_UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


@dataclass(frozen=True)
class ArmatureSpace:
    """Axes and scale of an armature relative to a motion's."""

    axes: np.ndarray  # (3, 3) The rotation A from the motion's axes to the armature's.
    scale: float  # Meters per unit of the armature.

    @classmethod
    def of(cls, armature: bpy.types.Object) -> ArmatureSpace:
        """Returns the space of an object: its tilt and scale, but not its position and heading.

        So a figure that was rotated on the floor walks in the direction it faces.
        """
        _, turn, scale = armature.matrix_world.decompose()
        heading = turn.copy()
        heading.x = heading.y = 0
        tilt = heading.normalized().inverted() @ turn if heading.magnitude > 1e-6 else turn
        axes = np.array(tilt.to_matrix()).T @ _UPRIGHT
        return cls(axes, abs(scale.x * scale.y * scale.z) ** (1 / 3))


@dataclass(frozen=True)
class Keys:
    """Animation of one bone."""

    bone: str  # Its name.
    rotations: np.ndarray  # (frames, 3, 3) from its rest, in its own axes.
    # (frames, 3) from its rest, in its own axes and the armature's unit; None if it has none.
    translations: np.ndarray | None

    def moves(self) -> bool:
        """Returns whether there is anything to key."""
        return self.translations is not None or bool(
            np.abs(self.rotations - np.eye(3)).max() > _STILL
        )


class ArmatureBody:
    """The bones of an armature at rest, as arrays."""

    def __init__(self, armature: bpy.types.Object) -> None:
        self.space = ArmatureSpace.of(armature)
        roots = [bone for bone in armature.data.bones if bone.parent is None]
        tree = max(([root, *root.children_recursive] for root in roots), key=len)
        bones = sorted(tree, key=lambda bone: len(bone.parent_recursive))
        self.names = [bone.name for bone in bones]
        index = {name: number for number, name in enumerate(self.names)}
        self.parents = [index[bone.parent.name] if bone.parent else -1 for bone in bones]
        self.heads = np.array([bone.head_local for bone in bones])
        self.tips = np.array([bone.tail_local for bone in bones])
        self.rests = np.array([bone.matrix_local.to_3x3() for bone in bones])
        self.inherits = [bone.use_inherit_rotation for bone in bones]
        self.connected = [bone.use_connect for bone in bones]

    def has(self, names: Sequence[str]) -> bool:
        """Returns whether there is a bone for each of these joints."""
        return {*names} <= {*self.names}

    def write_rest(self, path: Path) -> dict[str, str]:
        """Writes the rest pose as BVH; returns the bone of each of its joints."""
        names = ["_".join(name.split()) for name in self.names]
        if len({*names}) < len(names):
            names = [f"{name}_{number}" for number, name in enumerate(names)]
        axes, scale = self.space.axes, self.space.scale
        heads, tips = (scale * points @ axes for points in (self.heads, self.tips))
        movable = [
            parent < 0 or not c for parent, c in zip(self.parents, self.connected, strict=True)
        ]
        write_rest(path, names, self.parents, heads, tips, movable)
        return dict(zip(names, self.names, strict=True))

    def carry(self, take: BvhTake, bones: Mapping[str, str]) -> list[Keys]:
        """Returns keys with which each bone points where its joint does.

        Args:
            take: The motion.
            bones: The bone of each joint; joints without one are left out.
        """
        return _Transfer(self, take, bones).keys()


class _Transfer:
    """One take retargeted to one armature; see the top of this file."""

    def __init__(self, body: ArmatureBody, take: BvhTake, bones: Mapping[str, str]) -> None:
        self.body, self.take = body, take
        self.rest = take.rest() @ body.space.axes.T
        joints = {bones[name]: joint for joint, name in enumerate(take.names) if name in bones}
        self.joint_of = [joints.get(name, -1) for name in body.names]
        self.bone_of = {joint: bone for bone, joint in enumerate(self.joint_of) if joint >= 0}
        # The armature's units per meter of the motion: all shared bones end to end.
        pairs = [
            (self.bone_of[joint], self.bone_of[parent], joint, parent)
            for joint, parent in enumerate(take.parents)
            if joint in self.bone_of and parent in self.bone_of
        ]
        self.size = 1 / body.space.scale
        if pairs:
            ends, starts, children, parents = (list(column) for column in zip(*pairs, strict=True))
            ours = np.linalg.norm(body.heads[ends] - body.heads[starts], axis=-1).sum()
            theirs = np.linalg.norm(self.rest[children] - self.rest[parents], axis=-1).sum()
            self.size = float(ours / theirs)
        # Rotations of all bones in the armature, and the same if the bone itself did not rotate.
        axes = body.space.axes
        self.unmoved = np.zeros((len(take.rotations), len(body.names), 3, 3))
        self.rotations = np.zeros_like(self.unmoved)
        straight = np.tile(np.eye(3), (len(body.names), 1, 1))
        for bone, (joint, parent) in enumerate(zip(self.joint_of, body.parents, strict=True)):
            rest = body.rests[bone]
            self.unmoved[:, bone] = rest
            if parent >= 0 and body.inherits[bone]:
                self.unmoved[:, bone] = self.rotations[:, parent] @ body.rests[parent].T @ rest
            self.rotations[:, bone] = self.unmoved[:, bone]
            if joint >= 0:
                straight[bone] = self._alignment(bone, straight[parent] if parent >= 0 else None)
                rotation = axes @ take.rotations[:, joint] @ axes.T @ straight[bone] @ rest
                self.rotations[:, bone] = rotation

    def keys(self) -> list[Keys]:
        """Returns keys of bones that move, or that have a bone below them that moves."""
        body, take, keys = self.body, self.take, []
        for bone, (name, joint) in enumerate(zip(body.names, self.joint_of, strict=True)):
            back, moved = np.swapaxes(self.unmoved[:, bone], -1, -2), None
            # How far a bone's head is from where its parent holds it, (frames, 3).
            if joint >= 0 and take.parents[joint] < 0:
                path = self.size * take.positions[:, joint] @ body.space.axes.T
                moved = path - body.heads[bone]
            elif joint >= 0 and not body.connected[bone]:
                steps = take.positions[:, joint] - take.offsets[joint]
                if np.abs(steps).max() >= _STILL:
                    parent = take.rotations[:, take.parents[joint]]
                    steps = self.size * np.einsum("tab,tb->ta", parent, steps)
                    moved = steps @ body.space.axes.T
            if moved is not None:
                moved = np.einsum("tab,tb->ta", back, moved)
            keys.append(Keys(name, back @ self.rotations[:, bone], moved))
        moving = [key.moves() for key in keys]
        for bone in reversed(range(len(keys))):
            if moving[bone] and body.parents[bone] >= 0:
                moving[body.parents[bone]] = True
        return [key for key, moves in zip(keys, moving, strict=True) if moves]

    def _alignment(self, bone: int, above: np.ndarray | None) -> np.ndarray:
        """Returns D, from the rest directions of a bone's children to those of the joint's."""
        joint, heads = self.joint_of[bone], self.body.heads
        below = [j for j, parent in enumerate(self.take.parents) if parent == joint]
        below = [j for j in below if j in self.bone_of]
        if not below:
            return np.eye(3) if above is None else above
        here = _units(heads[[self.bone_of[j] for j in below]] - heads[bone])
        there = _units(self.rest[below] - self.rest[joint])
        if len(below) == 1:  # the shortest rotation; none if a direction has no length
            if min(np.linalg.norm(here[0]), np.linalg.norm(there[0])) < 0.5:
                return np.eye(3)
            return np.array(Vector(here[0]).rotation_difference(Vector(there[0])).to_matrix())
        # The best rotation (Kabsch); where all directions lie on a line, without twist.
        left, _, right = np.linalg.svd(there.T @ here + 1e-4 * np.eye(3))
        return left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
