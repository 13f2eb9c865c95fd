"""Bones of constant length: a network draws joints one by one, so that bones breathe.

Each bone gets its median length, and the joints move as little as possible: in turns every bone
pulls its two ends to the right distance (position-based dynamics, Müller et al. 2007), ends in the
limbs rather than in the trunk; at last the tree is walked from the root, so that lengths are exact.
A bone that has shrunk says little about its direction, which is then the mean over the frames
around, weighted by length.
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
"""Deviation of the Gaussian over these neighbors, seconds."""

_TRUNK = 0.1
"""How easily joints of the trunk give way, compared to those of limbs."""


def constant_bones(
    joints: Float[np.ndarray, "frames joints 3"], fps: float, skeleton: Skeleton
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns joints near the given ones whose bones have the same length in every frame."""
    parents = list(skeleton.parents[1:])
    bones = joints[:, 1:] - joints[:, parents]
    lengths = np.median(np.linalg.norm(bones, axis=-1), axis=0)
    ease = _ease(skeleton)
    moved = joints.copy()
    for _ in range(_ROUNDS):
        for joint, (parent, length) in enumerate(zip(parents, lengths, strict=True), start=1):
            bone = moved[:, joint] - moved[:, parent]
            pull = bone * (1 - length / np.maximum(_norm(bone), 1e-6))
            share = ease[joint] / (ease[joint] + ease[parent])
            moved[:, joint] -= share * pull
            moved[:, parent] += (1 - share) * pull
    # Bones that had shrunk point where their neighbors in time do, too.
    pointing = unit(moved[:, 1:] - moved[:, parents])
    trust = np.clip(_norm(bones) / (_SHRUNK * lengths[:, None]), 0, 1) ** 2
    around = gaussian(trust * pointing, _MEMORY * fps)
    directions = unit(trust * pointing + (1 - trust) * unit(around))
    for joint, (parent, length) in enumerate(zip(parents, lengths, strict=True), start=1):
        moved[:, joint] = moved[:, parent] + length * directions[:, joint - 1]
    return keep_knee_direction(moved, joints, skeleton)


def _ease(skeleton: Skeleton) -> list[float]:
    """Returns how easily each joint gives way: limbs do, the trunk hardly.

    The trunk are joints where bones branch, those they hang on, and the first of each limb: where
    short bones between heavy parts turned by a little, the whole body would seem to turn.
    """
    branch = [len(skeleton.children(joint)) > 1 for joint in range(len(skeleton))]
    for joint in reversed(range(1, len(skeleton))):
        branch[skeleton.parents[joint]] |= branch[joint]
    return [
        _TRUNK if branch[j] or branch[max(p, 0)] else 1.0 for j, p in enumerate(skeleton.parents)
    ]


def _norm(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 1"]:
    return np.linalg.norm(vectors, axis=-1, keepdims=True)
