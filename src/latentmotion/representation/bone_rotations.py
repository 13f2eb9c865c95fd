"""Rotations of bones as HumanML3D measures them: the shortest turn from a rest direction, no twist.

world_j = between(direction_j, bone_j),  local_j = world_above⁻¹ world_j
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.kinematics.rotations import (
    matrix_from_quaternion,
    quaternion_between,
    quaternion_conjugate,
    quaternion_multiply,
    sixd_from_matrix,
)


def bone_rotations(
    bones: Float[Any, "frames joints 3"],
    yaw: Float[Any, " frames"],
    directions: Float[np.ndarray, "joints 3"],
    above: tuple[int, ...],
) -> Float[Any, "frames joints 6"]:
    """Returns the rotation of each joint in 6D, columns.

    Args:
        bones: From each joint's parent to the joint.
        yaw: Heading of the body, radians. The root's rotation is its inverse, as published.
        directions: Rest direction of each bone.
        above: The joint to whose rotation each one is relative.
    """
    xp = array_namespace(bones, yaw)
    rest = xp.asarray(directions, dtype=bones.dtype, device=device(bones))
    none = xp.zeros_like(yaw)
    root = xp.stack([xp.cos(yaw / 2), none, -xp.sin(yaw / 2), none], axis=-1)[:, None, :]
    world = xp.concat([root, quaternion_between(rest[1:], bones[:, 1:, :])], axis=1)
    local = quaternion_multiply(quaternion_conjugate(world[:, list(above), :]), world)
    return sixd_from_matrix(matrix_from_quaternion(local), "columns")
