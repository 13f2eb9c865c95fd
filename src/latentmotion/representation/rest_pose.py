"""Rotations from one rest pose told from another: the same motion, another zero.

World rotations W say where a body's parts point. With rest directions r of the new skeleton and
the bones b that leave a joint,

    one bone        W ← between(W r, b) W       so that W r = b, with the twist that W had
    several         W ← argmin Σ |W r - b|²     (Kabsch 1976)
    none            W ← W of the parent
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.rotations import matrix_from_quaternion, quaternion_between
from latentmotion.kinematics.skeleton import Skeleton


def rotations_from(
    skeleton: Skeleton, animation: Animation
) -> Float[np.ndarray, "frames joints 3 3"]:
    """Returns local rotations of a skeleton that make the same bones as the animation.

    Args:
        skeleton: Whose rest pose is wanted; the animation's joints, with other offsets.
        animation: The motion, told from its own rest pose.
    """
    joints, world = animation.joints(), _world(animation)
    for joint, parent in enumerate(skeleton.parents):
        children = list(skeleton.children(joint))
        bones = joints[:, children] - joints[:, [joint]]
        rest = skeleton.offsets[children]
        if len(children) > 1:
            world[:, joint] = _fitted(rest, bones)
        elif children:
            swing = quaternion_between(world[:, joint] @ rest[0], bones[:, 0])
            world[:, joint] = matrix_from_quaternion(swing) @ world[:, joint]
        elif parent >= 0:
            world[:, joint] = world[:, parent]
    return _local(world, skeleton)


def _world(animation: Animation) -> Float[np.ndarray, "frames joints 3 3"]:
    world = np.array(animation.rotations, dtype=np.float64)
    for joint, parent in list(enumerate(animation.skeleton.parents))[1:]:
        world[:, joint] = world[:, parent] @ world[:, joint]
    return world


def _local(
    world: Float[np.ndarray, "frames joints 3 3"], skeleton: Skeleton
) -> Float[np.ndarray, "frames joints 3 3"]:
    local = world.copy()
    above = list(skeleton.parents[1:])
    local[:, 1:] = np.swapaxes(world[:, above], -1, -2) @ world[:, 1:]
    return local


def _fitted(
    rest: Float[np.ndarray, "bones 3"], bones: Float[np.ndarray, "frames bones 3"]
) -> Float[np.ndarray, "frames 3 3"]:
    u, _, vt = np.linalg.svd(np.einsum("tci,cj->tij", bones, rest))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return u @ vt
