"""Rig: a skeleton that the user brings, stood upright; the source character that moves it.

Files keep rigs in any unit and with any axis up. The joints themselves tell how a body stands:

    up       from ankles to head, the nearest axis          left   from the right hip to the left
    ahead    left × up                                      unit   in which its legs are a person's

Inspection of characters: their bones, and the bones that correspond to our joints.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.errors import DataError, ReadingWarning
from latentmotion.kinematics import draft, standing
from latentmotion.kinematics.bone_names import OPTIONAL, REQUIRED, SIDES, JointMap
from latentmotion.kinematics.humanoid import Humanoid, find_humanoid, fitting_map, to_humanml3d
from latentmotion.kinematics.skeleton import Animation, Joints, Skeleton, posed
from latentmotion.motion import Motion
from latentmotion.retarget.rig_files import RigFile, open_rig

Rotations = Float[np.ndarray, "frames 3 3"]

# Height of the lowest joint above the floor where the file does not say, as a share of the leg's
# length.
_SOLE = 0.02

# Percentile of the frames whose lowest joint is taken to be on the floor of a file.
_LOWEST = 2.0


@dataclass(frozen=True, eq=False)
class Rig:
    """A skeleton to retarget motions to."""

    file: RigFile  # The file it comes from, which also writes it.
    body: Humanoid  # Its joints by our names; the skeleton is in meters, y up, facing +z.
    axes: Float[np.ndarray, "3 3"]  # Its left, up and ahead in the file's axes.
    meters: float  # Meters per unit of the file.
    root: Float[np.ndarray, " 3"]  # Rest position of joint 0, meters, the floor at height 0.
    floor: float  # Height of the floor in the file, meters.
    leg: float  # Length of thigh and shank, meters.
    order: tuple[int, ...]  # Each joint's index in the file.
    # Where the file's own rest pose does not stand: the rotations to the one that does.
    bases: Float[np.ndarray, "joints 3 3"] | None = None
    guesses: tuple[str, ...] = ()  # What its body alone showed, and the option that overrules it.

    @property
    def skeleton(self) -> Skeleton:
        """Rest pose in meters, y up, facing +z; feet and arms hang as bodies' do."""
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
        up = np.array([0, self.floor, 0])
        animation = replace(animation, root_positions=animation.root_positions + up)
        if self.body.skeleton.names != self.file.skeleton.names:
            back = np.argsort(self.order)  # feet hang where they do in the file
            world = animation.skeleton.world_rotations(animation.rotations)[:, back]
            places = animation.joints()[:, back]
            offsets = self.meters * np.asarray(self.file.skeleton.offsets) @ self.axes
            level = replace(self.file.skeleton, offsets=offsets)  # meters, y up, facing +z
            animation = posed(level, world, places, animation.fps)
        if self.bases is not None:
            animation = standing.rebased(animation, np.swapaxes(self.bases, -1, -2))
        scaled = standing.in_axes(animation, self.axes.T, 1 / self.meters)
        skeleton, translations = self.file.skeleton, scaled.translations
        if translations is None and not np.allclose(scaled.skeleton.offsets, skeleton.offsets):
            translations = np.repeat(scaled.skeleton.offsets[None], len(scaled), axis=0)
        return replace(scaled, skeleton=skeleton, translations=translations)

    def unit(self) -> str:
        """Returns the name of the file's unit of length."""
        units = standing.METERS_PER_UNIT.items()
        names = (name for name, meters in units if abs(meters - self.meters) < 1e-9)
        return next(names, f"{self.meters:g} m")


@dataclass(frozen=True, eq=False)
class RigPose:
    """A rig over time; joints without a rotation of their own rest in their parents."""

    rig: Rig  # The rig.
    # Rotations of some joints in the world, away from the rest pose.
    rotations: Mapping[int, Rotations]
    hips: Float[np.ndarray, "frames 3"]  # The middle of both hips, meters, the floor at height 0.

    def moved(
        self, rotations: Mapping[int, Rotations], hips: Float[np.ndarray, "frames 3"] | None = None
    ) -> RigPose:
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
    def joints(self) -> Joints:
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


def read_rig(
    path: str | Path, joint_map: JointMap | None = None, stated: standing.Stated | None = None
) -> Rig:
    """Reads a rig from `.glb`, `.gltf`, `.vrm`, `.fbx` or `.bvh`.

    Args:
        path: The file.
        joint_map: Our joints → the rig's; by default found by their names.
        stated: Unit, axis and rate as the user states them.

    Raises:
        FileFormatError: The file is damaged.
        DataError: Joints that are needed are not found.
        InputError: There is no such file, or of no such kind.

    Warns:
        ReadingWarning: Its unit or axes are a guess.
    """
    file, stated = open_rig(path), stated or standing.NOTHING
    joint_map = joint_map or fitting_map(stated.joint_maps, file.skeleton.names)
    rig = make_rig(file, find_humanoid(file.skeleton, file.declared, joint_map), stated)
    if rig.guesses:
        warnings.warn(f"{path}: a guess: {', '.join(rig.guesses)}", ReadingWarning, stacklevel=2)
    return rig


def make_rig(file: RigFile, body: Humanoid, stated: standing.Stated = standing.NOTHING) -> Rig:
    """Stands a body upright, as its rest pose does, or its frames where a file has some.

    Raises:
        DataError: It cannot stand.
    """
    if file.animation is not None:
        return _moving_rig(file, file.animation, body, stated)
    body, order = _hung_as_bodies_do(body)
    try:
        rest_pose = standing.RestPose.of(body)
    except DataError as error:
        if file.mirrored:
            raise DataError(
                "the rig is mirrored: a node above its bones, or a bone, has a negative scale; "
                "apply the scale in the program that wrote it (Blender: Ctrl+A, All Transforms)"
            ) from error
        raise
    rest = to_humanml3d(Animation.at_rest(body.skeleton), body.joint_map())
    stance = standing.find_standing(rest, replace(stated, up="y"), file.unit, any_size=True)
    skeleton = standing.in_axes(
        Animation.at_rest(body.skeleton), rest_pose.axes, stance.meters
    ).skeleton
    root = stance.meters * file.root @ rest_pose.axes
    lowest = float(root[1] + skeleton.rest_joints()[:, 1].min())
    # Lowest joints between 1 % below and 14 % of a leg above the floor are ankles or toes that
    # stand on it.
    floor = 0.0 if 0 <= lowest + 0.01 * stance.leg <= 0.15 * stance.leg else None
    floor = lowest - _SOLE * stance.leg if floor is None else floor
    return Rig(
        file=file,
        body=replace(body, skeleton=skeleton),
        axes=rest_pose.axes,
        meters=stance.meters,
        root=root - (0, floor, 0),
        floor=floor,
        leg=stance.leg,
        order=order,
        guesses=stance.guesses,
    )


def _moving_rig(
    file: RigFile, animation: Animation, body: Humanoid, stated: standing.Stated
) -> Rig:
    """Returns a rig whose file's frames say how high it stands, and how, if its rest does not."""
    joints = to_humanml3d(animation, body.joint_map())
    stance = standing.find_standing(joints, stated, file.unit, any_size=True)
    joints = stance.meters * joints @ stance.axes
    moving = standing.upright(animation, stance)
    body, bases, axes = replace(body, skeleton=moving.skeleton), None, stance.axes
    if standing.rest_stands(body) and standing.up_at_rest(body) == "y":
        turn = standing.facing_at_rest(body)
        moving, axes = standing.in_axes(moving, turn, 1.0), axes @ turn
    else:
        if standing.rest_stands(body):  # along another axis than in the frames
            bases = np.tile(standing.RestPose.of(body).axes, (len(body.skeleton), 1, 1))
        else:
            bases = standing.standing_bases(moving, body, joints)
        moving = standing.rebased(moving, bases, standing.straightest(joints))
    heights = moving.joints()[:, :, 1].min(axis=1)
    rest = moving.skeleton.rest_joints()
    return Rig(
        file=file,
        body=replace(body, skeleton=moving.skeleton),
        axes=axes,
        meters=stance.meters,
        root=np.array([0.0, -rest[:, 1].min(), 0.0]),
        floor=float(np.percentile(heights, _LOWEST)),
        leg=stance.leg,
        order=tuple(range(len(rest))),
        bases=bases,
        guesses=stance.guesses,
    )


def _hung_as_bodies_do(body: Humanoid) -> tuple[Humanoid, tuple[int, ...]]:
    """Returns a body whose feet hang on its shanks and arms on its chest, and indices before."""
    old, count = body.skeleton, len(body.skeleton)
    if not body.rehung:
        return body, tuple(range(count))
    parents, rest = list(old.parents), old.rest_joints()
    for joint, above in body.rehung.items():
        parents[joint] = above
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


# Greatest height of a joint that stands, as a share of the leg's length.
_HIGHEST = {"foot": 0.08, "ankle": 0.2}


@dataclass(frozen=True, eq=False)
class SourceCharacter:
    """A moving body, described as if its rest pose stood upright facing +z."""

    body: Humanoid  # Its joints; its skeleton's rest pose is turned to face +z.
    joints: Joints  # Positions, meters, y up, the floor at height 0.
    # Rotations in the world, away from the rest pose.
    world: Float[np.ndarray, "frames joints 3 3"]
    fps: float  # Frames per second.
    leg: float  # Length of thigh and shank, meters.

    @classmethod
    def of(cls, source: Motion | Animation, body: Humanoid | None = None) -> SourceCharacter:
        """Returns the character of a motion; by default its joints are found by their names."""
        if isinstance(source, Motion):
            recorded = source.recorded
            animation = recorded.animation if recorded else source.animation()
            body = recorded.body if recorded else body
        else:
            animation = source
        body = body or find_humanoid(animation.skeleton)
        rest_pose = standing.RestPose.of(body)
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
        return self.body.skeleton.rest_joints() @ standing.RestPose.of(self.body).axes


@dataclass(frozen=True)
class RigReport:
    """Description of a character."""

    bones: tuple[str, ...]  # Names of its bones.
    mapping: dict[str, str | None]  # Our joints → its bones.
    guessed: tuple[str, ...] = ()  # Joints whose bones were guessed; people should look at them.
    missing: tuple[str, ...] = ()  # Joints that are needed and have no bone.
    problem: str | None = None  # Why no motion can be put on it yet.


def inspect_rig(path: str | Path, joint_map: Mapping[str, str] | None = None) -> RigReport:
    """Reads a character and finds its joints by their names; where that fails, they are guessed.

    Args:
        path: The file.
        joint_map: Our joints → its bones; by default found.

    Raises:
        FileFormatError: The file is damaged.
        DataError: The map names joints that are not there.
        InputError: There is no such file, or of no such kind.
    """
    file, guessed = open_rig(path), ()
    bones = file.skeleton.names
    if joint_map is None:
        try:
            joints: Mapping[str, int] = find_humanoid(file.skeleton, file.declared).joints
        except DataError:
            guesses = {}
            with suppress(DataError):  # it has no legs
                guesses = draft.draft_map(file.skeleton)
            joints = {ours: guess.joint for ours, guess in guesses.items()}
            guessed = tuple(guesses)
        joint_map = {ours: bones[joint] for ours, joint in joints.items()}
    mapping = {name: joint_map.get(name) for name in (*REQUIRED, *OPTIONAL)} | dict(joint_map)
    missing = tuple(name for name in REQUIRED if mapping[name] is None)
    problem = f"no bone is named for {', '.join(missing)}" if missing else None
    try:
        make_rig(file, find_humanoid(file.skeleton, joint_map=joint_map))
    except DataError as error:
        unknown = [bone for bone in joint_map.values() if bone not in bones]
        if unknown or set(joint_map) - {*REQUIRED, *OPTIONAL}:
            raise
        problem = problem or str(error)
    return RigReport(bones, mapping, guessed, missing, problem)
