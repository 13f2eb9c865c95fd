"""Rig: a skeleton that the user brings, stood upright; the source character that moves it.

Files keep rigs in any unit and with any axis up. The joints themselves tell how a body stands:

    up       from ankles to head, the nearest axis          left   from the right hip to the left
    ahead    left × up                                      unit   in which its legs are a person's
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.errors import DataError
from latentmotion.kinematics.bone_names import SIDES, JointMap
from latentmotion.kinematics.humanoid import Humanoid, find_humanoid
from latentmotion.kinematics.skeleton import Animation, Skeleton
from latentmotion.motion import Motion
from latentmotion.retarget.rig_files import RigFile, open_rig

Rotations = Float[np.ndarray, "frames 3 3"]

_UNITS: Mapping[str, float] = {
    **{"meters": 1.0, "centimeters": 0.01, "inches": 0.0254, "decimeters": 0.1},
    **{"millimeters": 0.001, "feet": 0.3048},
}
_LEG = 0.8
"""Typical length of a leg, meters."""

_SQUARE = np.radians(10)
"""A rest pose that faces an axis to within this angle is taken to face it."""

_SOLE = 0.02
"""Of a leg's length: height of the lowest joint above the floor where the file does not say."""


@dataclass(frozen=True, eq=False)
class RestPose:
    """The rest pose of a body in its own file."""

    axes: Float[np.ndarray, "3 3"]
    """Its left, up and ahead in the file's axes, in the columns."""
    leg: float
    """Length of thigh and shank, in the file's unit."""

    @classmethod
    def of(cls, body: Humanoid) -> RestPose:
        """Returns the rest pose of a body.

        Raises:
            DataError: It has no legs to stand on, or its toes point backward.
        """
        rest = body.skeleton.rest_joints()
        hips, knees, ankles = (
            np.stack([rest[body.joints[f"{side}_{name}"]] for side in SIDES])
            for name in ("hip", "knee", "ankle")
        )
        bones = np.stack([knees - hips, ankles - knees])
        leg = float(np.linalg.norm(bones, axis=-1).sum(0).mean())
        if np.linalg.norm(bones, axis=-1).min() <= 1e-6 * max(leg, 1e-9):
            raise DataError("a leg of the rig has a bone of length 0; correct the map of joints")
        upward, left = rest[body.chest] - ankles.mean(0), hips[0] - hips[1]
        axis = int(np.argmax(np.abs(upward)))
        up = np.eye(3)[axis] * np.sign(upward[axis])
        across = left - up * (left @ up)
        if np.linalg.norm(across) < 1e-9:
            raise DataError("both hips of the rig are at the same place; correct the map of joints")
        across /= np.linalg.norm(across)
        axis = int(np.argmax(np.abs(across)))
        nearest = np.eye(3)[axis] * np.sign(across[axis])
        across = nearest if across @ nearest > np.cos(_SQUARE) else across
        axes = np.stack([across, up, np.cross(across, up)], axis=-1)
        toes = [
            rest[body.joints[f"{side}_foot"]] - ankle
            for side, ankle in zip(SIDES, ankles, strict=True)
            if f"{side}_foot" in body.joints
        ]
        if toes and (np.sum(toes, axis=0) @ axes[:, 2]) < -0.02 * leg:
            raise DataError("the rig's toes point backward: left and right are mixed up in the map")
        return cls(axes, leg)


@dataclass(frozen=True, eq=False)
class Rig:
    """A skeleton to retarget motions to."""

    file: RigFile
    """The file it comes from, which also writes it."""
    body: Humanoid
    """Its joints by our names; the skeleton is in meters, y up, facing +z."""
    axes: Float[np.ndarray, "3 3"]
    """Its left, up and ahead in the file's axes."""
    meters: float
    """Meters per unit of the file."""
    root: Float[np.ndarray, " 3"]
    """Rest position of joint 0, meters, the floor at height 0."""
    floor: float
    """Height of the floor in the file, meters."""
    leg: float
    """Length of thigh and shank, meters."""
    order: tuple[int, ...]
    """Each joint's index in the file."""

    @property
    def skeleton(self) -> Skeleton:
        """Rest pose in meters, y up, facing +z; feet hang on their legs, unlike in some files."""
        return self.body.skeleton

    @property
    def root_motion_bone(self) -> int:
        """The joint whose position moves the body: the pelvis, or one above where it cannot."""
        line = self.body.lines[self.body.pelvis]
        return next((joint for joint in line if self.order[joint] in self.file.movable), 0)

    def rest(self) -> Float[np.ndarray, "joints 3"]:
        """Returns the rest positions of all joints, the floor at height 0."""
        return self.skeleton.rest_joints() + self.root

    def in_file(self, animation: Animation) -> Animation:
        """Returns an animation of this rig in axes and unit of its file."""
        axes, scale = self.axes, 1 / self.meters
        up = np.array([0, self.floor, 0])
        rotations, translations = animation.rotations, animation.translations
        if self.body.skeleton.names != self.file.skeleton.names:
            rotations, translations = self._hung_as_in_file(animation)
        return Animation(
            self.file.skeleton,
            axes @ rotations @ axes.T,
            scale * (animation.root_positions + up) @ axes.T,
            animation.fps,
            None if translations is None else scale * translations @ axes.T,
        )

    def _hung_as_in_file(self, animation: Animation) -> tuple[np.ndarray, np.ndarray]:
        """Returns rotations and translations relative to the parents in the file."""
        back = np.argsort(self.order)
        skeleton, parents = self.file.skeleton, list(self.file.skeleton.parents[1:])
        world = animation.skeleton.world_rotations(animation.rotations)[:, back]
        joints = animation.joints()[:, back]
        translations = np.zeros_like(joints)
        steps = joints[:, 1:] - joints[:, parents]
        translations[:, 1:] = np.einsum("tjab,tja->tjb", world[:, parents], steps)
        return skeleton.local_rotations(world), translations

    def unit(self) -> str:
        """Returns the name of the file's unit of length."""
        known = (name for name, meters in _UNITS.items() if abs(meters - self.meters) < 1e-9)
        return next(known, f"{self.meters:g} m")


@dataclass(frozen=True, eq=False)
class Pose:
    """A rig over time; joints without a rotation of their own rest in their parents."""

    rig: Rig
    """The rig."""
    rotations: Mapping[int, Rotations]
    """Rotations of some joints in the world, away from the rest pose."""
    hips: Float[np.ndarray, "frames 3"]
    """The middle of both hips, meters, the floor at height 0."""

    def moved(
        self, rotations: Mapping[int, Rotations], hips: Float[np.ndarray, "frames 3"] | None = None
    ) -> Pose:
        """Returns the pose with other rotations of some joints, and other hips."""
        return replace(
            self,
            rotations={**self.rotations, **rotations},
            hips=self.hips if hips is None else hips,
        )

    @cached_property
    def world(self) -> Float[np.ndarray, "frames joints 3 3"]:
        """Rotations of all joints in the world."""
        skeleton = self.rig.skeleton
        world = np.tile(np.eye(3), (len(self.hips), len(skeleton), 1, 1))
        for joint, parent in enumerate(skeleton.parents):
            if joint in self.rotations:
                world[:, joint] = self.rotations[joint]
            elif parent >= 0:
                world[:, joint] = world[:, parent]
        return world

    @cached_property
    def joints(self) -> Float[np.ndarray, "frames joints 3"]:
        """Positions of all joints."""
        return self.animation(1.0).joints()

    def position(self, name: str) -> Float[np.ndarray, "frames 3"]:
        """Returns the positions of one of our joints."""
        return self.joints[:, self.rig.body.joints[name]]

    def animation(self, fps: float) -> Animation:
        """Returns its local rotations, and the trajectory of the root-motion bone."""
        skeleton, bone, translations = self.rig.skeleton, self.rig.root_motion_bone, None
        rotations = skeleton.local_rotations(self.world)
        root = np.tile(self.rig.root, (len(self.world), 1))
        if bone == 0:
            root = self._root_motion()
        else:
            translations = np.repeat(skeleton.offsets[None], len(self.world), axis=0)
            translations[:, bone] = self._root_motion() - self.rig.rest()[skeleton.parents[bone]]
        return Animation(skeleton, rotations, root, fps, translations)

    def _root_motion(self) -> Float[np.ndarray, "frames 3"]:
        """Returns positions of the root-motion bone; between it and the pelvis nothing rotates."""
        rig, rest = self.rig, self.rig.rest()
        hips = np.mean([rest[rig.body.joints[f"{side}_hip"]] for side in SIDES], axis=0)
        pelvis = self.hips - self.world[:, rig.body.pelvis] @ (hips - rest[rig.body.pelvis])
        return pelvis - (rest[rig.body.pelvis] - rest[rig.root_motion_bone])


def read_rig(path: str | Path, joint_map: JointMap | None = None) -> Rig:
    """Reads a rig from `.glb`, `.gltf`, `.bvh` or `.asf`.

    Args:
        path: The file.
        joint_map: Our joints → the rig's; by default found by their names.

    Raises:
        FileFormatError: The file is damaged.
        DataError: Joints that are needed are not found.
        InputError: There is no such file, or of no such kind.
    """
    file = open_rig(path)
    return make_rig(file, find_humanoid(file.skeleton, file.declared, joint_map))


def make_rig(file: RigFile, body: Humanoid) -> Rig:
    """Stands a body upright.

    Raises:
        DataError: It cannot stand.
    """
    body, order = _with_feet_on_legs(body)
    rest_pose = RestPose.of(body)
    likeliest = min(_UNITS.values(), key=lambda unit: _misfit(rest_pose.leg * unit))
    meters = file.unit or likeliest
    if _misfit(rest_pose.leg * meters) > np.log(4):
        meters = likeliest
    skeleton = replace(body.skeleton, offsets=meters * body.skeleton.offsets @ rest_pose.axes)
    root = meters * file.root @ rest_pose.axes
    lowest = float(root[1] + skeleton.rest_joints()[:, 1].min())
    leg = rest_pose.leg * meters
    floor = 0.0 if 0 <= lowest + 0.01 * leg <= 0.15 * leg else lowest - _SOLE * leg
    return Rig(
        file=file,
        body=replace(body, skeleton=skeleton),
        axes=rest_pose.axes,
        meters=meters,
        root=root - (0, floor, 0),
        floor=floor,
        leg=leg,
        order=order,
    )


def _with_feet_on_legs(body: Humanoid) -> tuple[Humanoid, tuple[int, ...]]:
    """Returns a body whose feet hang on their shanks, and each joint's index before."""
    old, count = body.skeleton, len(body.skeleton)
    if not body.free_feet:
        return body, tuple(range(count))
    parents, rest = list(old.parents), old.rest_joints()
    for ankle in body.free_feet:
        parents[body.joints[ankle]] = body.joints[ankle.replace("ankle", "knee")]
    order = [0]
    for joint in order:  # grows: children after their parents
        order += [child for child in range(count) if parents[child] == joint]
    rank = {joint: number for number, joint in enumerate(order)}
    above = [-1, *(parents[joint] for joint in order[1:])]
    skeleton = Skeleton(
        name=old.name,
        names=tuple(old.names[joint] for joint in order),
        parents=tuple(rank.get(parent, -1) for parent in above),
        offsets=np.array(
            [
                rest[j] - rest[p] if p >= 0 else 0 * rest[0]
                for j, p in zip(order, above, strict=True)
            ]
        ),
        end_sites=tuple(rank[joint] for joint in old.end_sites),
    )
    joints = {name: rank[joint] for name, joint in body.joints.items()}
    return Humanoid(skeleton, joints, body.names), tuple(order)


def _misfit(leg: float) -> float:
    """Returns how far a leg of so many meters is from a person's, as a logarithm."""
    return abs(float(np.log(leg / _LEG)))


_HIGHEST = {"foot": 0.08, "ankle": 0.2}
"""Of a leg's length: greatest height of a joint that stands."""


@dataclass(frozen=True, eq=False)
class SourceCharacter:
    """A moving body, described as if its rest pose stood upright facing +z."""

    body: Humanoid
    """Its joints; its skeleton's rest pose is turned to face +z."""
    joints: Float[np.ndarray, "frames joints 3"]
    """Positions, meters, y up, the floor at height 0."""
    world: Float[np.ndarray, "frames joints 3 3"]
    """Rotations in the world, away from the rest pose."""
    fps: float
    """Frames per second."""
    leg: float
    """Length of thigh and shank, meters."""

    @classmethod
    def of(cls, source: Motion | Animation, body: Humanoid | None = None) -> SourceCharacter:
        """Returns the character of a motion; by default its joints are found by their names."""
        animation = source.animation() if isinstance(source, Motion) else source
        body = body or find_humanoid(animation.skeleton)
        rest_pose = RestPose.of(body)
        world = animation.skeleton.world_rotations(animation.rotations) @ rest_pose.axes
        return cls(body, animation.joints(), world, animation.fps, rest_pose.leg)

    def rotation(self, name: str) -> Rotations:
        """Returns the rotations of one of our joints in the world."""
        return self.world[:, self.body.joints[name]]

    def position(self, name: str) -> Float[np.ndarray, "frames 3"]:
        """Returns the positions of one of our joints, meters."""
        return self.joints[:, self.body.joints[name]]

    def standing_height(self, joint: str) -> float:
        """Returns the height of `ankle` or `foot` above the floor while they stand, meters."""
        tip = "foot" if f"{SIDES[0]}_foot" in self.body.joints else "ankle"
        heights = np.stack([self.position(f"{side}_{tip}")[:, 1] for side in SIDES])
        low = float(np.percentile(heights.min(0), 5))
        lowest = float(np.clip(low, 0, _HIGHEST[tip] * self.leg))
        rest = [
            self.rest()[self.body.joints[f"{side}_{name}"], 1]
            for name in (joint, tip)
            for side in SIDES
        ]
        return lowest + (sum(rest[:2]) - sum(rest[2:])) / 2

    def contacts(self, side: str) -> Bool[np.ndarray, " frames"]:
        """Returns when the toes of a foot stand on the floor, or the ankle where it has none."""
        tip = f"{side}_foot" if f"{side}_foot" in self.body.joints else f"{side}_ankle"
        feet = replace(self.body.skeleton, left_foot=(self.body.joints[tip],), right_foot=())
        return foot_contacts(self.joints, self.fps, feet)[:, 0]

    def rest(self) -> Float[np.ndarray, "joints 3"]:
        """Returns the rest pose, facing +z."""
        return self.body.skeleton.rest_joints() @ RestPose.of(self.body).axes
