"""A motion's joints on an armature's bones, whatever their axes, their rest pose and their unit.

With a joint turned by G from the motion's rest pose, A the turn from the motion's axes to the
armature's, D the turn from the bone's rest direction to the joint's, and R the bone's own rest:

    turn of the bone in the armature  =  A G Aᵀ · D · R
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from .bvh import Take, write_rest

_STILL = 1e-5
"""What is less is no movement: meters, and entries of a rotation."""

_UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""From the motion's axes (y up) to Blender's (z up)."""


@dataclass(frozen=True)
class Stance:
    """How a motion's axes lie in an armature."""

    axes: np.ndarray
    """(3, 3) A."""
    scale: float
    """Meters per unit of the armature."""

    @classmethod
    def of(cls, armature: bpy.types.Object) -> Stance:
        """Reads it off an object: its tilt and scale count, but where it stands and looks do not.

        So a figure that was turned on the floor walks where it looks.
        """
        _, turn, scale = armature.matrix_world.decompose()
        heading = turn.copy()
        heading.x = heading.y = 0
        tilt = heading.normalized().inverted() @ turn if heading.magnitude > 1e-6 else turn
        axes = np.array(tilt.to_matrix()).T @ _UPRIGHT
        return cls(axes, abs(scale.x * scale.y * scale.z) ** (1 / 3))


@dataclass(frozen=True)
class Keys:
    """How one bone moves: what its channels are to hold."""

    bone: str
    """Its name."""
    turns: np.ndarray
    """(frames, 3, 3) from its rest, in its own axes."""
    places: np.ndarray | None
    """(frames, 3) moves from its rest, in its own axes and the armature's unit, if it moves."""

    def moves(self) -> bool:
        """Says whether there is anything to key."""
        return self.places is not None or bool(np.abs(self.turns - np.eye(3)).max() > _STILL)


class Body:
    """The bones of an armature at rest, as arrays."""

    def __init__(self, armature: bpy.types.Object) -> None:
        self.stance = Stance.of(armature)
        bones = _largest_tree(armature.data.bones)
        self.names = [bone.name for bone in bones]
        index = {name: number for number, name in enumerate(self.names)}
        self.parents = [index[bone.parent.name] if bone.parent else -1 for bone in bones]
        self.heads = np.array([bone.head_local for bone in bones])
        self.tips = np.array([bone.tail_local for bone in bones])
        self.rests = np.array([bone.matrix_local.to_3x3() for bone in bones])
        self.inherits = [bone.use_inherit_rotation for bone in bones]
        self.connected = [bone.use_connect for bone in bones]

    def has(self, names: Sequence[str]) -> bool:
        """Says whether there is a bone for each of these joints."""
        return {*names} <= {*self.names}

    def write_rest(self, path: Path) -> dict[str, str]:
        """Writes the rest pose as BVH; returns the bone that each of its joints stands for."""
        names = ["_".join(name.split()) for name in self.names]
        if len({*names}) < len(names):
            names = [f"{name}_{number}" for number, name in enumerate(names)]
        axes, scale = self.stance.axes, self.stance.scale
        heads, tips = (scale * points @ axes for points in (self.heads, self.tips))
        movable = [
            parent < 0 or not c for parent, c in zip(self.parents, self.connected, strict=True)
        ]
        write_rest(path, names, self.parents, heads, tips, movable)
        return dict(zip(names, self.names, strict=True))

    def carry(self, take: Take, bones: Mapping[str, str]) -> list[Keys]:
        """Returns how the bones move so that each points where its joint does.

        Args:
            take: The motion.
            bones: The bone of each joint; joints that have none are left out.
        """
        return _Carrier(self, take, bones).keys()


class _Carrier:
    """One take on its way to one armature; see the head of this file."""

    def __init__(self, body: Body, take: Take, bones: Mapping[str, str]) -> None:
        self.body, self.take = body, take
        self.rest = take.rest() @ body.stance.axes.T
        joints = {bones[name]: joint for joint, name in enumerate(take.names) if name in bones}
        self.joint_of = [joints.get(name, -1) for name in body.names]
        self.bone_of = {joint: bone for bone, joint in enumerate(self.joint_of) if joint >= 0}
        self.size = self._size()
        self.unmoved = np.zeros((len(take.turns), len(body.names), 3, 3))
        self.turns = np.zeros_like(self.unmoved)
        self._turn_all()

    def keys(self) -> list[Keys]:
        """Returns what moves; bones that, with all below them, stay as they are, are left alone."""
        body = self.body
        own = [self._keys(bone) for bone in range(len(body.names))]
        moving = [keys.moves() for keys in own]
        for bone in reversed(range(len(own))):
            if moving[bone] and body.parents[bone] >= 0:
                moving[body.parents[bone]] = True
        return [keys for keys, moves in zip(own, moving, strict=True) if moves]

    def _keys(self, bone: int) -> Keys:
        back = np.swapaxes(self.unmoved[:, bone], -1, -2)
        move = self._move(bone)
        places = None if move is None else np.einsum("tab,tb->ta", back, move)
        return Keys(self.body.names[bone], back @ self.turns[:, bone], places)

    def _move(self, bone: int) -> np.ndarray | None:
        """Returns (frames, 3) how far a bone's head is from where its parent holds it."""
        body, take, joint = self.body, self.take, self.joint_of[bone]
        if joint < 0:
            return None
        if take.parents[joint] < 0:
            return self.size * take.places[:, joint] @ body.stance.axes.T - body.heads[bone]
        moves = take.places[:, joint] - take.offsets[joint]
        if body.connected[bone] or np.abs(moves).max() < _STILL:
            return None
        parent = take.turns[:, take.parents[joint]]
        return self.size * np.einsum("tab,tb->ta", parent, moves) @ body.stance.axes.T

    def _turn_all(self) -> None:
        body, axes = self.body, self.body.stance.axes
        straight = np.tile(np.eye(3), (len(body.names), 1, 1))
        for bone, (joint, parent) in enumerate(zip(self.joint_of, body.parents, strict=True)):
            rest = body.rests[bone]
            self.unmoved[:, bone] = rest
            if parent >= 0 and body.inherits[bone]:
                self.unmoved[:, bone] = self.turns[:, parent] @ body.rests[parent].T @ rest
            self.turns[:, bone] = self.unmoved[:, bone]
            if joint >= 0:
                straight[bone] = self._straight(bone, straight[parent] if parent >= 0 else None)
                self.turns[:, bone] = (
                    axes @ self.take.turns[:, joint] @ axes.T @ straight[bone] @ rest
                )

    def _straight(self, bone: int, above: np.ndarray | None) -> np.ndarray:
        """Returns D, from where a bone's children are at rest to where the joint's are."""
        joint, heads = self.joint_of[bone], self.body.heads
        below = [j for j, parent in enumerate(self.take.parents) if parent == joint]
        below = [j for j in below if j in self.bone_of]
        here = _units(heads[[self.bone_of[j] for j in below]] - heads[bone])
        there = _units(self.rest[below] - self.rest[joint])
        if len(below) == 1:
            return _arc(here[0], there[0])
        return _fit(here, there) if below else np.eye(3) if above is None else above

    def _size(self) -> float:
        """Returns the armature's units for a meter of the motion: all shared bones end to end."""
        pairs = [
            (self.bone_of[joint], self.bone_of[parent], joint, parent)
            for joint, parent in enumerate(self.take.parents)
            if joint in self.bone_of and parent in self.bone_of
        ]
        if not pairs:
            return 1 / self.body.stance.scale
        bones, above, joints, parents = (list(each) for each in zip(*pairs, strict=True))
        own = np.linalg.norm(self.body.heads[bones] - self.body.heads[above], axis=-1).sum()
        return float(own / np.linalg.norm(self.rest[joints] - self.rest[parents], axis=-1).sum())


def _largest_tree(bones: bpy.types.ArmatureBones) -> list[bpy.types.Bone]:
    """Returns the bones under the root that has most of them, parents first."""
    trees = [[root, *root.children_recursive] for root in bones if root.parent is None]
    tree = max(trees, key=len)
    return sorted(tree, key=lambda bone: len(bone.parent_recursive))


def _units(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _arc(here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Returns the shortest turn from one direction to another; none where one has no length."""
    if min(np.linalg.norm(here), np.linalg.norm(there)) < 0.5:
        return np.eye(3)
    return np.array(Vector(here).rotation_difference(Vector(there)).to_matrix())


def _fit(here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Returns the turn that takes several directions to others as nearly as can be (Kabsch).

    What they leave open, where all lie on a line, is no turn.
    """
    left, _, right = np.linalg.svd(there.T @ here + 1e-4 * np.eye(3))
    sign = np.sign(np.linalg.det(left @ right))
    return left @ np.diag([1, 1, sign]) @ right
