"""Canonical bodies: heading, bone lengths, start, and rotations relative to a given rest pose.

Heading. The angle about the vertical at which a body faces, radians, 0 towards +z and positive
towards +x: forward = y × across, where `across` points from the left side of the body to its right.

Canonical form. One body's bone lengths, on the floor, starting at the origin and facing +z.

Change of rest pose. The same motion as rotations away from another rest pose. With world rotations
W, rest directions r of the new skeleton and the bones b that leave a joint:

    one bone        W ← between(W r, b) W       so that W r = b, with the twist of W
    several         W ← argmin Σ |W r - b|²     (Kabsch 1976)
    none            W ← W of the parent

HumanML3D's rotations. The shortest rotation from a rest direction, without twist:

    world_j = between(direction_j, bone_j),  local_j = world_above⁻¹ world_j
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.kinematics import rotations
from latentmotion.kinematics.inverse_kinematics import nearest_rotation
from latentmotion.kinematics.skeleton import Animation, Skeleton
from latentmotion.representation.interface import AnyJoints

# Standard deviation, frames, of the Gaussian with which HumanML3D smooths the heading.
SMOOTHING_FRAMES = 20.0


def heading(joints: Float[Any, "*frames joints 3"], skeleton: Skeleton) -> Float[Any, "*frames"]:
    """Returns the heading of hips and shoulders together, radians."""
    xp = array_namespace(joints)
    across = _across(joints, skeleton, "hip") + _across(joints, skeleton, "shoulder")
    return xp.atan2(across[..., 2], -across[..., 0])


def smooth_heading(joints: AnyJoints, skeleton: Skeleton) -> Float[Any, " frames"]:
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
    frames, kernel = signal.shape[0], _kernel(sigma)
    radius = len(kernel) // 2
    if xp is np:  # a seventh of the time of the sum below where the kernel is wide
        padded = signal.take(np.arange(-radius, frames + radius), axis=0, mode="clip")
        columns = [np.correlate(column, kernel) for column in padded.T]
        return np.stack(columns, axis=1).astype(signal.dtype, copy=False)
    padded = xp.concat([signal[:1]] * radius + [signal] + [signal[-1:]] * radius, axis=0)
    return sum(
        float(weight) * padded[first : first + frames] for first, weight in enumerate(kernel)
    )


@lru_cache(maxsize=64)
def _kernel(sigma: float) -> Float[np.ndarray, " width"]:
    radius = int(4 * sigma + 0.5)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return weights / weights.sum()


def turn(vectors: Float[Any, "*#batch 3"], angle: Float[Any, "*#batch"]) -> Float[Any, "*batch 3"]:
    """Rotates vectors about the vertical; a positive angle, radians, moves +z towards +x."""
    xp = array_namespace(vectors, angle)
    c, s = xp.cos(angle), xp.sin(angle)
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return xp.stack([c * x + s * z, y + 0 * c, c * z - s * x], axis=-1)


def _across(
    joints: Float[Any, "*frames joints 3"], skeleton: Skeleton, joint: str
) -> Float[Any, "*frames 3"]:
    right, left = skeleton.names.index(f"right_{joint}"), skeleton.names.index(f"left_{joint}")
    return joints[..., right, :] - joints[..., left, :]


# Share of a leg's length below which a bone counts as missing; the shortest real one has 0.06.
_SHORTEST = 0.02


def retarget(joints: AnyJoints, skeleton: Skeleton, leg: tuple[int, ...]) -> AnyJoints:
    """Gives a body the bone lengths of a skeleton; bones keep their directions.

    The root trajectory is scaled by the ratio of the leg lengths, the source's in frame 0. A bone
    that the source lacks, because two joints coincide, continues in the direction of its parent.

    Args:
        joints: Positions of the same joints in another body, in any unit.
        skeleton: The skeleton with the wanted bone lengths.
        leg: Joints whose bones make up the length of a leg.
    """
    xp = array_namespace(joints)
    target = np.linalg.norm(skeleton.offsets, axis=-1)
    bones = joints - joints[:, [max(parent, 0) for parent in skeleton.parents], :]
    lengths = xp.sqrt(xp.sum(bones * bones, axis=-1))
    source_leg = sum(lengths[0, j] for j in leg)
    goal = xp.asarray(target, dtype=joints.dtype, device=device(joints))
    # What is left of a bone of length zero is rounding, which points anywhere.
    lacking = (lengths <= _SHORTEST * source_leg)[..., None]
    safe = xp.where(lengths > 0, lengths, xp.ones_like(lengths))
    directions = bones / safe[..., None]
    parents = list(enumerate(skeleton.parents))[1:]
    if xp.any(lacking[:, 1:]):
        straight = [directions[:, 0, :]]
        for joint, parent in parents:
            bone = directions[:, joint, :]
            straight.append(xp.where(lacking[:, joint, :], straight[parent], bone))
        directions = xp.stack(straight, axis=1)
    steps = goal[:, None] * directions
    placed = [joints[:, 0, :] * (float(sum(target[j] for j in leg)) / source_leg)]
    for joint, parent in parents:
        placed.append(placed[parent] + steps[:, joint, :])
    return xp.stack(placed, axis=1)


def canonicalize(joints: AnyJoints, skeleton: Skeleton) -> AnyJoints:
    """Moves the lowest point of a clip to the floor and its start to the origin, facing +z."""
    xp = array_namespace(joints)
    start = joints[0, 0, :]
    corner = xp.stack([start[0], xp.min(joints[..., 1]), start[2]])
    return turn(joints - corner, -heading(joints[0], skeleton))


def rotations_from(
    skeleton: Skeleton, animation: Animation
) -> Float[np.ndarray, "frames joints 3 3"]:
    """Returns local rotations of a skeleton that make the same bones as the animation.

    Args:
        skeleton: The skeleton with the wanted rest pose and the animation's joints.
        animation: The motion, as rotations from its own rest pose.
    """
    joints = animation.joints()
    world = animation.skeleton.world_rotations(animation.rotations)
    for joint, parent in enumerate(skeleton.parents):
        children = list(skeleton.children(joint))
        bones = joints[:, children] - joints[:, [joint]]
        rest = skeleton.offsets[children]
        if len(children) > 1:
            world[:, joint] = nearest_rotation(np.einsum("tci,cj->tij", bones, rest))
        elif children:
            swing = rotations.matrix_between(world[:, joint] @ rest[0], bones[:, 0])
            world[:, joint] = swing @ world[:, joint]
        elif parent >= 0:
            world[:, joint] = world[:, parent]
    return skeleton.local_rotations(world)


def bone_rotations(
    bones: AnyJoints,
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
    world = xp.concat([root, rotations.quaternion_between(rest[1:], bones[:, 1:, :])], axis=1)
    local = rotations.quaternion_multiply(
        rotations.quaternion_conjugate(world[:, list(above), :]), world
    )
    return rotations.sixd_from_matrix(rotations.matrix_from_quaternion(local), "columns")
