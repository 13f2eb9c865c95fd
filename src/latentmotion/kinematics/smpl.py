"""Linear blend skinning: a surface that follows bones (Loper et al., SMPL, 2015, section 3).

    shaped   = template + shape_directions β                                  (vertices, 3)
    joints   = joint_regressor shaped                                         (joints, 3)
    posed    = shaped + pose_directions vec(R_1 - I, …, R_J-1 - I)
    vertex i = Σ_j weights_ij (W_j (posed_i - joints_j) + place_j)

W_j and place_j are the rotation and place of joint j in the world, by forward kinematics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from jaxtyping import Float

from latentmotion.arrays import array_namespace, device


@dataclass(frozen=True, eq=False)
class Body:
    """A surface and how it follows its bones; NumPy or PyTorch arrays."""

    template: Float[Any, "vertices 3"]
    """The surface in rest pose, meters, y up."""
    shape_directions: Float[Any, "vertices 3 shapes"]
    """How the surface changes with each number of the shape."""
    pose_directions: Float[Any, "vertices 3 bends"]
    """How it changes with each entry of R - I of the joints but the root, row by row."""
    joint_regressor: Float[Any, "joints vertices"]
    """Which mean of vertices each joint is."""
    weights: Float[Any, "vertices joints"]
    """How much each vertex follows each joint; rows sum to 1."""
    parents: tuple[int, ...]
    """Index of each joint's parent; -1 for the root, which is joint 0."""

    def like(self, array: Any) -> Body:
        """Returns the body as arrays of another one's library, precision and device."""
        xp, parts = array_namespace(array), dict(vars(self))
        parents = parts.pop("parents")
        kind = {"dtype": array.dtype, "device": device(array)}
        return Body(**{k: xp.asarray(v, **kind) for k, v in parts.items()}, parents=parents)

    def shaped(self, shape: Float[Any, " shapes"] | None = None) -> Float[Any, "vertices 3"]:
        """Returns the surface in rest pose; by default that of the mean person."""
        if shape is None:
            return self.template
        xp = array_namespace(self.template, shape)
        return self.template + xp.sum(self.shape_directions * shape, axis=-1)

    def rest_joints(self, shape: Float[Any, " shapes"] | None = None) -> Float[Any, "joints 3"]:
        """Returns where the joints are in rest pose."""
        return self.joint_regressor @ self.shaped(shape)

    def posed(
        self, rotations: Float[Any, "*batch joints 3 3"], shape: Float[Any, " shapes"] | None = None
    ) -> Float[Any, "*batch vertices 3"]:
        """Returns the surface in a pose, the root joint where it is in rest pose.

        Args:
            rotations: Rotation of each joint relative to its parent; the root's is the body's.
            shape: The person; by default the mean one.
        """
        xp = array_namespace(self.template, rotations)
        joints = self.rest_joints(shape)
        world, places = _kinematics(rotations, joints, self.parents)
        shifts = places - xp.sum(world * joints[:, None, :], axis=-1)
        moves = xp.concat([world, shifts[..., None]], axis=-1)  #  (…, joints, 3, 4)
        blended = self.weights @ xp.reshape(moves, (*moves.shape[:-2], 12))
        blended = xp.reshape(blended, (*blended.shape[:-1], 3, 4))
        surface = self.shaped(shape) + self._bulges(rotations)
        return xp.sum(blended[..., :3] * surface[..., None, :], axis=-1) + blended[..., 3]

    def _bulges(
        self, rotations: Float[Any, "*batch joints 3 3"]
    ) -> Float[Any, "*batch vertices 3"]:
        xp = array_namespace(self.template, rotations)
        bends = rotations[..., 1:, :, :] - xp.eye(
            3, dtype=rotations.dtype, device=device(rotations)
        )
        bends = xp.reshape(bends, (*bends.shape[:-3], -1))
        count = self.pose_directions.shape[-1]
        moved = bends @ xp.reshape(self.pose_directions, (-1, count)).T
        return xp.reshape(moved, (*moved.shape[:-1], -1, 3))


def _kinematics(
    rotations: Float[Any, "*batch joints 3 3"],
    joints: Float[Any, "joints 3"],
    parents: tuple[int, ...],
) -> tuple[Float[Any, "*batch joints 3 3"], Float[Any, "*batch joints 3"]]:
    """Returns rotation and place of each joint in the world."""
    xp = array_namespace(rotations, joints)
    world = [rotations[..., 0, :, :]]
    places = [joints[0] + xp.zeros_like(rotations[..., 0, :, 0])]
    for joint, parent in list(enumerate(parents))[1:]:
        offset = joints[joint] - joints[parent]
        places.append(places[parent] + xp.sum(world[parent] * offset, axis=-1))
        world.append(world[parent] @ rotations[..., joint, :, :])
    return xp.stack(world, axis=-3), xp.stack(places, axis=-2)
