"""Bodies in one place and rest pose: headings, bone lengths, rotations.

Where a body faces: a heading about the vertical, 0 towards +z and positive towards +x.

forward = y × across, across = the way from the left side of the body to its right (radians).

One body in one place: canonical bone lengths, on the floor, from the origin towards +z.

Rotations from one rest pose told from another: the same motion, another zero.

World rotations W say where a body's parts point. With rest directions r of the new skeleton and
the bones b that leave a joint,

    one bone        W ← between(W r, b) W       so that W r = b, with the twist that W had
    several         W ← argmin Σ |W r - b|²     (Kabsch 1976)
    none            W ← W of the parent

Rotations of bones as HumanML3D measures them: the shortest turn from a rest direction, no twist.

world_j = between(direction_j, bone_j),  local_j = world_above⁻¹ world_j
"""

from __future__ import annotations

from math import exp
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.rotations import (
    matrix_between,
    matrix_from_quaternion,
    quaternion_between,
    quaternion_conjugate,
    quaternion_multiply,
    sixd_from_matrix,
)
from latentmotion.kinematics.skeleton import Skeleton

SMOOTHING_FRAMES = 20.0
"""Standard deviation of the Gaussian that HumanML3D smooths the heading with."""


def heading(joints: Float[Any, "*frames joints 3"], skeleton: Skeleton) -> Float[Any, "*frames"]:
    """Returns where hips and shoulders together face."""
    xp = array_namespace(joints)
    across = _across(joints, skeleton, "hip") + _across(joints, skeleton, "shoulder")
    return xp.atan2(across[..., 2], -across[..., 0])


def smooth_heading(
    joints: Float[Any, "frames joints 3"], skeleton: Skeleton
) -> Float[Any, " frames"]:
    """Returns the heading as HumanML3D's inverse kinematics measures it.

    There the hips arrive swapped, so that they work against the shoulders; published features
    can only be met by doing the same.
    """
    xp = array_namespace(joints)
    across = _across(joints, skeleton, "shoulder") - _across(joints, skeleton, "hip")
    across = across / (xp.sqrt(xp.sum(across * across, axis=-1, keepdims=True)) + 1e-12)
    forward = gaussian_smooth(xp.stack([across[:, 2], -across[:, 0]], axis=-1), SMOOTHING_FRAMES)
    return xp.atan2(forward[:, 0], forward[:, 1])


def gaussian_smooth(signal: Float[Any, "frames n"], sigma: float) -> Float[Any, "frames n"]:
    """Smooths along the first axis; the ends are continued by their own value.

    Args:
        signal: Values over time.
        sigma: Standard deviation in frames; the kernel ends at four of them, as SciPy's does.
    """
    xp = array_namespace(signal)
    frames, radius = signal.shape[0], int(4 * sigma + 0.5)
    weights = [exp(-0.5 * (n / sigma) ** 2) for n in range(radius + 1)]
    padded = xp.concat([signal[:1]] * radius + [signal] + [signal[-1:]] * radius, axis=0)
    total = signal * weights[0]
    for n in range(1, radius + 1):
        before, after = radius - n, radius + n
        total = total + weights[n] * (
            padded[before : before + frames] + padded[after : after + frames]
        )
    return total / (2 * sum(weights) - weights[0])


def turn(vectors: Float[Any, "*#batch 3"], angle: Float[Any, "*#batch"]) -> Float[Any, "*batch 3"]:
    """Turns vectors about the vertical by an angle that moves +z towards +x."""
    xp = array_namespace(vectors, angle)
    c, s = xp.cos(angle), xp.sin(angle)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return xp.stack([c * x + s * z, y + 0 * c, c * z - s * x], axis=-1)


def _across(
    joints: Float[Any, "*frames joints 3"], skeleton: Skeleton, part: str
) -> Float[Any, "*frames 3"]:
    right, left = skeleton.names.index(f"right_{part}"), skeleton.names.index(f"left_{part}")
    return joints[..., right, :] - joints[..., left, :]


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


def rotations_from(
    skeleton: Skeleton, animation: Animation
) -> Float[np.ndarray, "frames joints 3 3"]:
    """Returns local rotations of a skeleton that make the same bones as the animation.

    Args:
        skeleton: Whose rest pose is wanted; the animation's joints, with other offsets.
        animation: The motion, told from its own rest pose.
    """
    joints = animation.joints()
    world = animation.skeleton.world_rotations(animation.rotations)
    for joint, parent in enumerate(skeleton.parents):
        children = list(skeleton.children(joint))
        bones = joints[:, children] - joints[:, [joint]]
        rest = skeleton.offsets[children]
        if len(children) > 1:
            world[:, joint] = _fitted(rest, bones)
        elif children:
            swing = matrix_between(world[:, joint] @ rest[0], bones[:, 0])
            world[:, joint] = swing @ world[:, joint]
        elif parent >= 0:
            world[:, joint] = world[:, parent]
    return skeleton.local_rotations(world)


def _fitted(
    rest: Float[np.ndarray, "bones 3"], bones: Float[np.ndarray, "frames bones 3"]
) -> Float[np.ndarray, "frames 3 3"]:
    u, _, vt = np.linalg.svd(np.einsum("tci,cj->tij", bones, rest))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return u @ vt


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
