"""One body in one place: canonical bone lengths, on the floor, from the origin towards +z."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.representation.facing import heading, turn

_SHORTEST = 0.02
"""Part of the length of a leg below which a bone is none; the shortest real one is 0.06 of it."""


def retarget(
    joints: Float[Any, "frames joints 3"], skeleton: Skeleton, leg: tuple[int, ...]
) -> Float[Any, "frames joints 3"]:
    """Gives a body the bone lengths of a skeleton; bones keep their directions.

    The path of the root is scaled by the ratio of the leg lengths, the source's in frame 0. A bone
    that the source lacks, where two joints are in one place, goes on as the bone above it does.

    Args:
        joints: Positions of the same joints in another body, in any unit.
        skeleton: Whose bone lengths are wanted.
        leg: Joints whose bones make up the length of a leg.
    """
    xp = array_namespace(joints)
    target = np.linalg.norm(skeleton.offsets, axis=-1)
    bones = joints - joints[:, [max(parent, 0) for parent in skeleton.parents], :]
    lengths = xp.sqrt(xp.sum(bones * bones, axis=-1))
    own_leg = sum(lengths[0, j] for j in leg)
    goal = xp.asarray(target, dtype=joints.dtype, device=device(joints))
    # What is left of a bone of length zero is rounding, which points anywhere.
    lacking = (lengths <= _SHORTEST * own_leg)[..., None]
    safe = xp.where(lengths > 0, lengths, xp.ones_like(lengths))
    directions = [bones[:, j, :] / safe[:, j, None] for j in range(len(skeleton))]
    placed = [joints[:, 0, :] * (float(sum(target[j] for j in leg)) / own_leg)]
    for joint, parent in list(enumerate(skeleton.parents))[1:]:
        above = directions[parent]
        directions[joint] = xp.where(lacking[:, joint, :], above, directions[joint])
        placed.append(placed[parent] + goal[joint] * directions[joint])
    return xp.stack(placed, axis=1)


def canonicalize(
    joints: Float[Any, "frames joints 3"], skeleton: Skeleton
) -> Float[Any, "frames joints 3"]:
    """Puts the lowest point of a clip on the floor and its start at the origin, facing +z."""
    xp = array_namespace(joints)
    start = joints[0, 0, :]
    corner = xp.stack([start[0], xp.min(joints[..., 1]), start[2]])
    return turn(joints - corner, -heading(joints[0], skeleton))
