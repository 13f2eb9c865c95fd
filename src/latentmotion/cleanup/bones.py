"""Bones of constant length: a network places each joint by itself, so bone lengths vary.

Each bone gets its median length, and the joints move as little as possible: one after another,
every bone pulls its two ends to the right distance (position-based dynamics, Müller et al. 2007),
ends in the limbs more than in the trunk; finally lengths are made exact from the root outward. The
direction of a bone that has shrunk is uncertain, so it becomes the mean over the frames around it,
weighted by length.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from latentmotion.arrays import Lengths, length, quantile, real_frames
from latentmotion.cleanup.leg_ik import keep_knee_direction
from latentmotion.cleanup.smoothing import gaussian
from latentmotion.kinematics.skeleton import BatchedJoints, Skeleton

# Rounds of pulls.
_ROUNDS = 10
# Share of its length below which a bone's direction is taken from its neighbors in time, too.
_SHRUNK = 0.7

# Standard deviation of the Gaussian over these neighbors, seconds.
_MEMORY = 0.1

# Stiffness of the trunk: movement of its joints relative to those of limbs.
_TRUNK = 0.1


def constant_bones(
    joints: BatchedJoints, fps: float, skeleton: Skeleton, lengths: Lengths = None
) -> BatchedJoints:
    """Returns joints near the given ones whose bones have the same length in every frame.

    Args:
        joints: Positions, meters.
        fps: Frames per second.
        skeleton: Says what bones are.
        lengths: Frames of each motion of a padded batch; padding stays as it is.
    """
    every = joints.reshape(len(joints), -1, *joints.shape[-2:])
    parents = [0, *skeleton.parents[1:]]
    spans = length(every - every[..., parents, :])
    medians = np.broadcast_to(quantile(spans, 0.5, lengths), spans.shape)
    real = np.broadcast_to(real_frames(lengths, len(every)), every.shape[:2])
    # Joints and coordinates first, all frames of all motions last: long rows, which NumPy is quick
    # with where they are rows in memory, too. The root is a bone of length 0.
    moved, span, size = (
        values[real].reshape(-1, len(parents), n).transpose(1, 2, 0).copy()
        for values, n in ((every, 3), (spans, 1), (medians, 1))
    )
    for ends, shares in _pulls(skeleton.parents):
        places = moved.take(ends, axis=0)
        bones = places[0] - places[1]
        bones *= 1 - size.take(ends[0], axis=0) / np.maximum(_norm(bones), 1e-6)
        places += shares * bones
        moved[ends] = places
    steps = _unit(moved - moved[parents])
    # Bones that had shrunk point where their neighbors in time point.
    trust = np.minimum(span / np.maximum(_SHRUNK * size, 1e-12), 1) ** 2
    shrunk = np.flatnonzero(trust[1:].min(axis=(1, 2)) < 1) + 1
    if len(shrunk):
        share = trust[shrunk]
        trusted = share * steps[shrunk]
        around = np.zeros((*real.shape, len(shrunk), 3))
        around[real] = trusted.transpose(2, 0, 1)
        around = gaussian(around, _MEMORY * fps, lengths)[real].transpose(1, 2, 0)
        steps[shrunk] = _unit(trusted + (1 - share) * _unit(around))
    steps *= size
    for joint, parent in enumerate(parents[1:], start=1):
        np.add(moved[parent], steps[joint], out=moved[joint])
    even = every.copy()
    even[real] = moved.transpose(2, 0, 1)
    return keep_knee_direction(even, every, skeleton).reshape(joints.shape)


@lru_cache(maxsize=16)
def _pulls(
    parents: tuple[int, ...],
) -> list[tuple[Int[np.ndarray, "2 bones"], Float[np.ndarray, "2 bones 1 1"]]]:
    """Returns the pulls of all rounds in their order, those that share no joint together.

    A bone pulls after those before it with which it shares a joint, so the result is that of one
    pull after another.

    Returns:
        Both ends of bones, the upper one last, and by which share of the pull they are moved.
    """
    count = len(parents)
    # Joints of the trunk hardly move: those where bones branch, their ancestors, and the first of
    # each limb. Turning the short bones between heavy parts a little would turn the whole body.
    trunk = [parents.count(joint) > 1 for joint in range(count)]
    for joint in reversed(range(1, count)):
        trunk[parents[joint]] |= trunk[joint]
    ease = [_TRUNK if trunk[j] or trunk[max(p, 0)] else 1.0 for j, p in enumerate(parents)]
    turns: list[list[int]] = []
    free = [0] * count
    for _ in range(_ROUNDS):
        for joint, parent in enumerate(parents[1:], start=1):
            turn = max(free[joint], free[parent])
            free[joint] = free[parent] = turn + 1
            if turn == len(turns):
                turns.append([])
            turns[turn].append(joint)
    ends = [np.array([turn, [parents[joint] for joint in turn]]) for turn in turns]
    eases = [np.array(ease)[pair] for pair in ends]
    shares = [each / each.sum(axis=0) * [[-1], [1]] for each in eases]
    return [(pair, share[..., None, None]) for pair, share in zip(ends, shares, strict=True)]


def _norm(vectors: Float[np.ndarray, "n 3 all"]) -> Float[np.ndarray, "n 1 all"]:
    return np.sqrt(np.einsum("ncf,ncf->nf", vectors, vectors))[:, None]


def _unit(vectors: Float[np.ndarray, "n 3 all"]) -> Float[np.ndarray, "n 3 all"]:
    return vectors / np.maximum(_norm(vectors), 1e-12)
