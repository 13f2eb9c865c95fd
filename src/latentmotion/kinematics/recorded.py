"""Recorded: the animation that a motion was read from, with all its joints and their rotations.

A motion is the positions of some 22 joints. Heads, hands, fingers and the twist of forearms turn
without moving these, so a motion that was read from a skeleton keeps what it was read from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from latentmotion.kinematics import standing
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.humanoid import Humanoid
from latentmotion.kinematics.inverse_kinematics import solve_batch
from latentmotion.kinematics.rotations import matrix_between
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Joints


@dataclass(frozen=True, eq=False)
class Recorded:
    """An animation whose rest pose stands."""

    animation: Animation  # Rotations of all joints, meters, y up.
    body: Humanoid  # Its joints by our names.

    @classmethod
    def of(cls, animation: Animation, body: Humanoid, joints: Joints) -> Recorded:
        """Returns an animation; where its rest pose does not stand, a frame of it is the new one.

        Args:
            animation: In meters, y up.
            body: Its joints by our names.
            joints: The positions of HumanML3D's 22.
        """
        if not standing.rest_stands(body):
            bases = standing.standing_bases(animation, body, joints)
            animation = standing.rebased(animation, bases, standing.straightest(joints))
        return cls(animation, replace(body, skeleton=animation.skeleton))

    def cut(self, first: int, stop: int) -> Recorded:
        """Returns some of its frames."""
        return replace(self, animation=self.animation.picked(slice(first, stop)))

    def resampled(self, fps: float) -> Recorded:
        """Returns it at another frame rate."""
        return replace(self, animation=self.animation.resampled(fps))

    def at_rate(self, fps: float) -> Recorded:
        """Returns the same frames, faster or slower."""
        return replace(self, animation=replace(self.animation, fps=fps))

    def turning(self, solved: Animation) -> Animation:
        """Returns rotations of HumanML3D's joints that turn heads, hands and forearms as these do.

        The positions do not change: forearms turn about themselves, heads and hands carry nothing.

        Args:
            solved: Rotations that were found from the positions alone, as many frames.
        """
        ours, theirs = solved.skeleton, self.body
        axes = standing.RestPose.of(theirs).axes
        source = theirs.skeleton.world_rotations(self.animation.rotations) @ axes
        rest, world = theirs.skeleton.rest_joints() @ axes, ours.world_rotations(solved.rotations)
        index, offsets = ours.names.index, np.asarray(ours.offsets)
        if "head" in theirs.joints:
            world[:, index("head")] = source[:, theirs.joints["head"]]
        for side in SIDES:
            turn = np.eye(3)
            for upper, lower in (("shoulder", "elbow"), ("elbow", "wrist")):
                at, end = f"{side}_{upper}", f"{side}_{lower}"
                bone, joint = offsets[index(end)], theirs.joints[at]
                target = rest[theirs.joints[end]] - rest[joint]
                turn = matrix_between(turn @ bone, target) @ turn
                if upper == "elbow":
                    along, turned = world[:, index(at)] @ bone, source[:, joint] @ turn
                    world[:, index(at)] = matrix_between(turned @ bone, along) @ turned
            world[:, index(end)] = source[:, theirs.joints[end]] @ turn
        return replace(solved, rotations=ours.local_rotations(world))

    def following(self, before: Joints, after: Joints) -> Recorded:
        """Returns the animation moved as HumanML3D's joints were, by clean-up for example.

        A joint turns in the world as ours does in the inverse kinematics of the positions; joints
        that are none of ours turn with those that carry them, so that fingers stay as they are.

        Args:
            before: The positions before, HumanML3D's joints first.
            after: The positions after, as many frames.
        """
        count, old = len(HUMANML3D), self.animation
        pair = np.stack([before[:, :count], after[:, :count]], axis=1).astype(np.float64)
        start, end = (
            animation.skeleton.world_rotations(animation.rotations)
            for animation in solve_batch(pair, old.fps, HUMANML3D)
        )
        change = (end @ np.swapaxes(start, -1, -2))[:, standing.carriers(self.body)]
        world = change @ old.skeleton.world_rotations(old.rotations)
        moved = replace(old, rotations=old.skeleton.local_rotations(world))
        pelvis, change_of_place = self.body.pelvis, pair[:, 1, 0] - pair[:, 0, 0]
        target = old.joints()[:, pelvis] + change_of_place
        root = moved.root_positions + target - moved.joints()[:, pelvis]
        return replace(self, animation=replace(moved, root_positions=root))
