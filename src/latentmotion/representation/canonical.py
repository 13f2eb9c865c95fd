"""One body in one place: canonical bone lengths, on the floor, from the origin towards +z."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.representation.facing import heading, turn
from latentmotion.skeleton import Skeleton


def retarget(
    joints: Float[Any, "frames joints 3"], skeleton: Skeleton, leg: tuple[int, ...]
) -> Float[Any, "frames joints 3"]:
    """Gives a body the bone lengths of a skeleton; bones keep their directions.

    The path of the root is scaled by the ratio of the leg lengths, the source's in frame 0.

    Args:
        joints: Positions of the same joints in another body, in any unit.
        skeleton: Whose bone lengths are wanted.
        leg: Joints whose bones make up the length of a leg.
    """
    xp = array_namespace(joints)
    target = np.linalg.norm(skeleton.offsets, axis=-1)
    bones = joints - joints[:, [max(parent, 0) for parent in skeleton.parents], :]
    lengths = xp.sqrt(xp.sum(bones * bones, axis=-1))
    scale = float(sum(target[j] for j in leg)) / sum(lengths[0, j] for j in leg)
    goal = xp.asarray(target, dtype=joints.dtype, device=device(joints))
    # A bone of length zero has no direction; it stays a point.
    safe = xp.where(lengths > 0, lengths, xp.ones_like(lengths))
    bones = bones * (goal / safe)[..., None]
    placed = [joints[:, 0, :] * scale]
    for joint, parent in list(enumerate(skeleton.parents))[1:]:
        placed.append(placed[parent] + bones[:, joint, :])
    return xp.stack(placed, axis=1)


def canonicalize(
    joints: Float[Any, "frames joints 3"], skeleton: Skeleton
) -> Float[Any, "frames joints 3"]:
    """Puts the lowest point of a clip on the floor and its start at the origin, facing +z."""
    xp = array_namespace(joints)
    start = joints[0, 0, :]
    corner = xp.stack([start[0], xp.min(joints[..., 1]), start[2]])
    return turn(joints - corner, -heading(joints[0], skeleton))
