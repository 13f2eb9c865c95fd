"""The source character: the body whose motion is retargeted, with its rotations in the world."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.kinematics.animation import Animation
from latentmotion.motion import Motion
from latentmotion.retarget.humanoid import SIDES, Humanoid, find_humanoid
from latentmotion.retarget.rig import RestPose, Rotations

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
