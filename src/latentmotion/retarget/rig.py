"""Rig: a skeleton that the user brings, stood upright: meters, y up, facing +z, its floor known.

Files keep rigs in any unit and with any axis up. How a body stands is seen from itself:

    up       from ankles to head, the nearest axis          left   from the right hip to the left
    ahead    left × up                                      unit   the one that makes it a person
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import DataError
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.humanoid import JointMap
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.retarget.humanoid import SIDES, Humanoid, find_humanoid, humanoid_of_map
from latentmotion.retarget.rig_files import RigFile, open_rig

_UNITS: Mapping[str, float] = {
    **{"meters": 1.0, "centimeters": 0.01, "inches": 0.0254, "decimeters": 0.1},
    **{"millimeters": 0.001, "feet": 0.3048},
}
_LEG = 0.8
"""Meters that a leg is long, more or less."""

_SQUARE = np.radians(10)
"""Rests that face an axis to within this angle are taken to face it."""

_SOLE = 0.02
"""Of a leg's length: how far the lowest joint is above the floor where the file does not say."""


@dataclass(frozen=True, eq=False)
class RestPose:
    """How a body stands at rest in its own file."""

    axes: Float[np.ndarray, "3 3"]
    """Its left, up and ahead in the file's axes, in the columns."""
    leg: float
    """Length of thigh and shank, in the file's unit."""

    @classmethod
    def of(cls, body: Humanoid) -> RestPose:
        """Finds how a body stands.

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
        axes = _axes(rest[body.chest] - ankles.mean(0), hips[0] - hips[1])
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
    """A skeleton to carry motions to."""

    file: RigFile
    """Where it comes from and how it is written."""
    body: Humanoid
    """Which joint is which; its skeleton is in meters, y up, facing +z."""
    axes: Float[np.ndarray, "3 3"]
    """Its left, up and ahead in the file's axes."""
    meters: float
    """Per unit of the file."""
    root: Float[np.ndarray, " 3"]
    """Where joint 0 rests, meters above the floor."""
    floor: float
    """Height of the floor in the file, meters."""
    leg: float
    """Length of thigh and shank, meters."""

    @property
    def skeleton(self) -> Skeleton:
        """Rest pose in meters, y up, facing +z."""
        return self.body.skeleton

    @property
    def root_motion_bone(self) -> int:
        """The joint whose position moves the body: the pelvis, or one above where it cannot."""
        line = self.body.lines[self.body.pelvis]
        return next((joint for joint in line if joint in self.file.movable), 0)

    def rest(self) -> Float[np.ndarray, "joints 3"]:
        """Returns where all joints rest, the floor at height 0."""
        return self.skeleton.rest_joints() + self.root

    def in_file(self, animation: Animation) -> Animation:
        """Returns an animation of this rig in axes and unit of its file."""
        axes, scale = self.axes, 1 / self.meters
        up = np.array([0, self.floor, 0])
        moves = animation.translations
        return Animation(
            self.file.skeleton,
            axes @ animation.rotations @ axes.T,
            scale * (animation.root_positions + up) @ axes.T,
            animation.fps,
            None if moves is None else scale * moves @ axes.T,
        )

    def unit(self) -> str:
        """Returns the name of the file's unit of length."""
        known = (name for name, meters in _UNITS.items() if abs(meters - self.meters) < 1e-9)
        return next(known, f"{self.meters:g} m")


def read_rig(path: str | Path, joint_map: JointMap | None = None) -> Rig:
    """Reads a rig from `.glb`, `.gltf`, `.bvh` or `.asf`.

    Args:
        path: The file.
        joint_map: Ours → its joints; by default found by their names.

    Raises:
        FileFormatError: The file is damaged.
        DataError: Joints that are needed are not found.
        InputError: There is no such file, or of no such kind.
    """
    file = open_rig(path)
    if joint_map is not None:
        return make_rig(file, humanoid_of_map(file.skeleton, joint_map))
    return make_rig(file, find_humanoid(file.skeleton, file.declared))


def make_rig(file: RigFile, body: Humanoid) -> Rig:
    """Stands a body upright.

    Raises:
        DataError: It cannot stand.
    """
    rest_pose = RestPose.of(body)
    meters = file.unit or min(_UNITS.values(), key=lambda unit: _off(rest_pose.leg * unit))
    if _off(rest_pose.leg * meters) > np.log(4):
        meters = min(_UNITS.values(), key=lambda unit: _off(rest_pose.leg * unit))
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
    )


def _off(leg: float) -> float:
    return abs(float(np.log(leg / _LEG)))


def _axes(
    upward: Float[np.ndarray, " 3"], left: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "3 3"]:
    axis = int(np.argmax(np.abs(upward)))
    up = np.eye(3)[axis] * np.sign(upward[axis])
    across = left - up * (left @ up)
    if np.linalg.norm(across) < 1e-9:
        raise DataError("both hips of the rig are at the same place; correct the map of joints")
    across /= np.linalg.norm(across)
    nearest = np.eye(3)[np.argmax(np.abs(across))] * np.sign(across[np.argmax(np.abs(across))])
    across = nearest if across @ nearest > np.cos(_SQUARE) else across
    return np.stack([across, up, np.cross(across, up)], axis=-1)
