"""Knees bend ahead: none is turned backward, or farther backward, by a step of the clean-up."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.legs import find_legs
from latentmotion.kinematics.skeleton import Skeleton

Joints = Float[np.ndarray, "frames joints 3"]
Points = Float[np.ndarray, "frames 3"]


def keep_ahead(moved: Joints, joints: Joints, skeleton: Skeleton) -> Joints:
    """Returns the moved joints with knees turned about the line hip–ankle, as little as it takes.

    Args:
        moved: Joints after a step.
        joints: The same before it.
        skeleton: Says what legs are.
    """
    legs = find_legs(skeleton)
    if len(legs) < 2:
        return moved
    kept = moved.copy()
    for leg in legs:
        chain = [leg.hip, leg.knee, leg.ankle]
        across = [x[:, legs[0].hip] - x[:, legs[1].hip] for x in (joints, moved)]
        before, _, _ = _bend(joints[:, chain], across[0])
        after, ahead, bend = _bend(moved[:, chain], across[1])
        least = np.minimum(before, 0)
        aside = bend - ahead * after
        room = np.sqrt(np.maximum(_norm(bend) ** 2 - least**2, 0))
        turned = ahead * least + aside / np.maximum(_norm(aside), 1e-9) * room
        wrong = (after < least) & (_norm(bend) > np.abs(least))
        kept[:, leg.knee] += np.where(wrong, turned - bend, 0)
    return kept


def _bend(
    leg: Float[np.ndarray, "frames 3 3"], across: Points
) -> tuple[Float[np.ndarray, "frames 1"], Points, Points]:
    """Returns how far the knee is ahead of the line hip–ankle, that direction, and the knee."""
    hip, knee, ankle = np.moveaxis(leg, 1, 0)
    axis = (hip - ankle) / np.maximum(_norm(hip - ankle), 1e-9)
    ahead = np.cross(across, axis)
    ahead = ahead / np.maximum(_norm(ahead), 1e-9)
    bend = knee - hip
    bend = bend - axis * (bend * axis).sum(axis=-1, keepdims=True)
    return (bend * ahead).sum(axis=-1, keepdims=True), ahead, bend


def _norm(vectors: Points) -> Float[np.ndarray, "frames 1"]:
    return np.linalg.norm(vectors, axis=-1, keepdims=True)
