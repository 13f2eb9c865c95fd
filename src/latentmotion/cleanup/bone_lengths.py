"""Bones of constant length: a network places each joint by itself, so bone lengths vary.

Each bone gets its median length, and the joints move as little as possible: one after another,
every bone pulls its two ends to the right distance (position-based dynamics, Müller et al. 2007),
ends in the limbs more than in the trunk; finally lengths are made exact from the root outward. The
direction of a bone that has shrunk is uncertain, so it becomes the mean over the frames around it,
weighted by length.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.cleanup.leg_ik import keep_knee_direction
from latentmotion.cleanup.smoothing import gaussian
from latentmotion.kinematics.skeleton import Skeleton

_ROUNDS = 10
_SHRUNK = 0.7
"""Share of its length below which a bone's direction is taken from its neighbors in time, too."""

_MEMORY = 0.1
"""Standard deviation of the Gaussian over these neighbors, seconds."""

_TRUNK = 0.1
"""How far joints of the trunk move, relative to those of limbs."""


def constant_bones(
    joints: Float[np.ndarray, "frames joints 3"], fps: float, skeleton: Skeleton
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns joints near the given ones whose bones have the same length in every frame."""
    parents = list(skeleton.parents[1:])
    bones = joints[:, 1:] - joints[:, parents]
    lengths = np.median(np.linalg.norm(bones, axis=-1), axis=0)
    # Joints of the trunk hardly move: those where bones branch, their ancestors, and the first of
    # each limb. Turning the short bones between heavy parts a little would turn the whole body.
    trunk = [len(skeleton.children(joint)) > 1 for joint in range(len(skeleton))]
    for joint in reversed(range(1, len(skeleton))):
        trunk[skeleton.parents[joint]] |= trunk[joint]
    ease = [_TRUNK if trunk[j] or trunk[max(p, 0)] else 1.0 for j, p in enumerate(skeleton.parents)]
    moved = joints.copy()
    for _ in range(_ROUNDS):
        for joint, (parent, length) in enumerate(zip(parents, lengths, strict=True), start=1):
            bone = moved[:, joint] - moved[:, parent]
            pull = bone * (1 - length / np.maximum(_norm(bone), 1e-6))
            share = ease[joint] / (ease[joint] + ease[parent])
            moved[:, joint] -= share * pull
            moved[:, parent] += (1 - share) * pull
    # Bones that had shrunk point where their neighbors in time point.
    pointing = unit(moved[:, 1:] - moved[:, parents])
    trust = np.clip(_norm(bones) / (_SHRUNK * lengths[:, None]), 0, 1) ** 2
    around = gaussian(trust * pointing, _MEMORY * fps)
    directions = unit(trust * pointing + (1 - trust) * unit(around))
    for joint, (parent, length) in enumerate(zip(parents, lengths, strict=True), start=1):
        moved[:, joint] = moved[:, parent] + length * directions[:, joint - 1]
    return keep_knee_direction(moved, joints, skeleton)


def _norm(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 1"]:
    return np.linalg.norm(vectors, axis=-1, keepdims=True)
