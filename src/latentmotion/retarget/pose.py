"""Pose: a rig over time, by how its known joints are turned in the world and where its hips are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.animation import Animation
from latentmotion.retarget.humanoid import SIDES
from latentmotion.retarget.rig import Rig

Rotations = Float[np.ndarray, "frames 3 3"]


@dataclass(frozen=True, eq=False)
class Pose:
    """Joints that are not known rest in their parents."""

    rig: Rig
    """Whose pose it is."""
    rotations: Mapping[int, Rotations]
    """Rotations of known joints in the world, away from the rest pose."""
    hips: Float[np.ndarray, "frames 3"]
    """The middle of both hips, meters, the floor at height 0."""

    def moved(
        self, rotations: Mapping[int, Rotations], hips: Float[np.ndarray, "frames 3"] | None = None
    ) -> Pose:
        """Returns it with some joints turned otherwise, and the hips elsewhere."""
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
        """Returns where one of our joints is."""
        return self.joints[:, self.rig.body.joints[name]]

    def animation(self, fps: float) -> Animation:
        """Returns its local rotations, and the trajectory of the root-motion bone."""
        skeleton, bone, moves = self.rig.skeleton, self.rig.root_motion_bone, None
        rotations = skeleton.local_rotations(self.world)
        root = np.tile(self.rig.root, (len(self.world), 1))
        if bone == 0:
            root = self._root_motion()
        else:
            moves = np.repeat(skeleton.offsets[None], len(self.world), axis=0)
            moves[:, bone] = self._root_motion() - self.rig.rest()[skeleton.parents[bone]]
        return Animation(skeleton, rotations, root, fps, moves)

    def _root_motion(self) -> Float[np.ndarray, "frames 3"]:
        """Returns where the root-motion bone is; between it and the pelvis nothing turns."""
        rig, rest = self.rig, self.rig.rest()
        hips = np.mean([rest[rig.body.joints[f"{side}_hip"]] for side in SIDES], axis=0)
        pelvis = self.hips - self.world[:, rig.body.pelvis] @ (hips - rest[rig.body.pelvis])
        return pelvis - (rest[rig.body.pelvis] - rest[rig.root_motion_bone])
