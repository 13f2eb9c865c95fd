"""HumanML3D's features: 263 numbers a frame with 22 joints, 251 with KIT's 21, 623 with hands.

    yaw_velocity   1         half the turn of the body from this frame to the next, radians
    root_velocity  2         the root's step to the next frame in that frame's heading, x and z
    root_height    1
    positions      3 (J-1)   joints but the root, in the frame of the body: heading +z, root at xz 0
    rotations      6 (J-1)   6D (columns) of each joint relative to its parent in the chain
    velocities     3 J       every joint's step to the next frame in this frame's heading
    contacts       4         left ankle, left toe, right ankle, right toe: 1 where it stands still

Guo et al., "Generating Diverse and Natural 3D Human Motions from Text", CVPR 2022, section 5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace
from latentmotion.kinematics import skeleton
from latentmotion.representation import canonical
from latentmotion.representation.interface import AnyJoints, Features, Positions, Representation


@dataclass(frozen=True, eq=False)
class HumanML3DRepresentation(Representation):
    """Joints to HumanML3D's features and back."""

    # Direction of each bone from which its rotation is measured.
    directions: Float[np.ndarray, "joints 3"]
    # Joints whose rotation is relative to the root, whatever their parent.
    chain_starts: tuple[int, ...]
    leg: tuple[int, ...]  # Joints whose bones make up the length of a leg.
    still: float  # A foot is in contact where its squared step is below this.
    # Whether rotations are computed; else they are 0, for networks that do not read them.
    rotated: bool = True

    @cached_property
    def blocks(self) -> Mapping[str, slice]:
        """The range of each block of features, by name."""
        joints = len(self.skeleton)
        widths = {"yaw_velocity": 1, "root_velocity": 2, "root_height": 1}
        widths |= {"positions": 3 * (joints - 1), "rotations": 6 * (joints - 1)}
        widths |= {"velocities": 3 * joints, "contacts": 4}
        ends = np.cumsum(list(widths.values())).tolist()
        pairs = zip(widths.items(), ends, strict=True)
        return {name: slice(end - width, end) for (name, width), end in pairs}

    def retarget(self, joints: AnyJoints) -> AnyJoints:
        """Gives a body of any size the canonical bone lengths and scales its path likewise."""
        return canonical.retarget(joints, self.skeleton, self.leg)

    def encode(self, joints: AnyJoints) -> Float[Any, "frames_less_one features"]:
        """Returns the features of a clip, whatever its position and heading on the floor.

        Args:
            joints: Global positions of at least two frames, meters, y up. Bone lengths are kept;
                call `retarget` first for a body of another size.

        Returns:
            Features in float32, one row less than frames, since the last has no velocity.

        Raises:
            InputError: The joints do not fit the skeleton, are too few or not finite.
        """
        self.check(joints)
        xp = array_namespace(joints)
        joints = canonical.canonicalize(xp.astype(joints, xp.float64), self.skeleton)
        yaw = canonical.smooth_heading(joints, self.skeleton)
        return self.describe(joints, xp.concat([xp.zeros_like(yaw[:1]), yaw[1:]]))

    def describe(
        self, joints: AnyJoints, yaw: Float[Any, " frames"]
    ) -> Float[Any, "frames_less_one features"]:
        """Returns the features of a clip in canonical form whose heading is known.

        Args:
            joints: Global positions, meters, y up, the floor at 0.
            yaw: Heading of the body, radians; 0 towards +z, positive towards +x.
        """
        xp = array_namespace(joints)
        steps, poses = joints[1:] - joints[:-1], joints[:-1]
        # Half a turn is only known up to π. Where the heading crosses -z, published features take
        # the wrong sign for that frame and their path bends; here it stays right.
        half = (yaw[:-1] - yaw[1:]) / 2
        half = half - pi * xp.round(half / pi)
        x, y, z = (poses[..., n] for n in range(3))
        centered = xp.stack([x - x[:, :1], y, z - z[:, :1]], axis=-1)
        rotations = xp.zeros((steps.shape[0], 6 * (len(self.skeleton) - 1)), dtype=steps.dtype)
        if self.rotated:
            parents = [max(parent, 0) for parent in self.skeleton.parents]
            above = tuple(0 if j in self.chain_starts else p for j, p in enumerate(parents))
            bones = poses - poses[:, parents, :]
            rotations = canonical.bone_rotations(bones, yaw[:-1], self.directions, above)[:, 1:, :]
        feet = steps[:, [*self.skeleton.left_foot, *self.skeleton.right_foot], :]
        blocks = [
            half,
            canonical.turn(steps[:, 0, :], -yaw[1:])[:, ::2],
            poses[:, 0, 1],
            canonical.turn(centered, -yaw[:-1, None])[:, 1:, :],
            rotations,
            canonical.turn(steps, -yaw[:-1, None]),
            xp.astype(xp.sum(feet * feet, axis=-1) < self.still, steps.dtype),
        ]
        rows = [xp.reshape(block, (steps.shape[0], -1)) for block in blocks]
        return xp.astype(xp.concat(rows, axis=1), xp.float32)

    def decode(self, features: Features) -> Positions:
        """Integrates rotations and steps of the root and adds the joints around it.

        Rotations, velocities and contacts are not used. The clip starts above the origin.
        """
        xp = array_namespace(features)
        half, step, height, positions = (
            features[..., self.blocks[name]]
            for name in ("yaw_velocity", "root_velocity", "root_height", "positions")
        )
        half = half[..., 0]
        turned = xp.cumulative_sum(half[..., :-1], axis=-1)
        yaw = -2 * xp.concat([xp.zeros_like(half[..., :1]), turned], axis=-1)
        nothing = xp.zeros_like(height)
        step = xp.concat([step[..., :1], nothing, step[..., 1:]], axis=-1)
        step = canonical.turn(step[..., :-1, :], yaw[..., 1:])
        path = xp.concat([xp.zeros_like(features[..., :1, :3]), step], axis=-2)
        path = xp.cumulative_sum(path, axis=-2)[..., None, :]
        local = xp.reshape(positions, (*positions.shape[:-1], -1, 3))
        root = xp.concat([nothing, height, nothing], axis=-1)[..., None, :]
        return canonical.turn(xp.concat([root, local], axis=-2), yaw[..., None]) + path

    @cached_property
    def _mirror_map(self) -> tuple[list[int], Float[np.ndarray, " features"]]:
        """The feature that each one comes from, and its sign."""
        other = np.array(self.skeleton.mirror)
        vector, sixd = [-1, 1, 1], [1, -1, -1, -1, 1, 1]
        swaps = {"yaw_velocity": ([0], [-1]), "root_velocity": ([0], [-1, 1])}
        swaps |= {"root_height": ([0], [1]), "positions": (other[1:] - 1, vector)}
        swaps |= {"rotations": (other[1:] - 1, sixd), "velocities": (other, vector)}
        swaps |= {"contacts": ([1, 0], [1, 1])}
        every, sources, signs = np.arange(self.width), [], []
        for name, (order, sign) in swaps.items():
            sources.extend(every[self.blocks[name]].reshape(len(order), -1)[order].ravel().tolist())
            signs.extend(sign * len(order))
        return sources, np.array(signs, dtype=np.float32)


# The 263 features of HumanML3D, meters.
HUMANML3D_FEATURES = HumanML3DRepresentation(
    name="humanml3d",
    skeleton=skeleton.HUMANML3D,
    fps=20.0,
    directions=skeleton.HUMANML3D_DIRECTIONS,
    chain_starts=(1, 2, 3, 13, 14),
    leg=(5, 8),
    still=0.002,
)

# The same features of 52 joints, SMPL-H's body and fingers: 623 numbers, meters.
HANDS_FEATURES = replace(
    HUMANML3D_FEATURES, name="hands", skeleton=skeleton.HANDS, directions=skeleton.HANDS_DIRECTIONS
)

# The 251 features of KIT-ML; published ones count a thousandth of the body height as 1.
KIT_FEATURES = HumanML3DRepresentation(
    name="kit",
    skeleton=skeleton.KIT,
    fps=12.5,
    directions=skeleton.KIT_DIRECTIONS,
    chain_starts=(1, 5, 8, 11, 16),
    leg=(17, 18),
    still=0.05,
)
