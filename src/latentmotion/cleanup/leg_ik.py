"""Leg inverse kinematics: which joints are legs, and how hip and knee bend for the ankle.

Two bones. Thigh and shank keep their lengths. The knee stays on its side of the line from hip to
ankle: its offset from that line rotates with the line, and any further bend is forward. A leg whose
ankle is already at its goal does not change at all.

Knee direction. Knees bend forward: no step of the clean-up may turn one backward, or farther
backward than it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.kinematics.rotations import quaternion_between, quaternion_rotate
from latentmotion.kinematics.skeleton import Skeleton

Joints = Float[np.ndarray, "frames joints 3"]
Points = Float[np.ndarray, "frames 3"]


@dataclass(frozen=True)
class Leg:
    """One leg, by joint indices."""

    hip: int
    knee: int
    ankle: int
    below: tuple[int, ...]
    """Descendants of the ankle: heel, toes."""
    pivots: tuple[int, ...]
    """Joints that touch the floor, the one that holds longest last."""


def find_legs(skeleton: Skeleton) -> list[Leg]:
    """Returns the legs, left and right; none if the skeleton names no feet or has no knees."""
    legs = []
    for foot in (skeleton.left_foot, skeleton.right_foot):
        chain = list(foot[:1])
        while chain and chain[-1] > 0:
            chain.append(skeleton.parents[chain[-1]])
        upper = next((n for n, j in enumerate(chain) if len(skeleton.children(j)) > 1), 0)
        if upper >= 3:
            hip, knee, ankle = chain[upper - 1], chain[upper - 2], chain[upper - 3]
            legs.append(Leg(hip, knee, ankle, _below(skeleton, ankle), foot))
    return legs


def _below(skeleton: Skeleton, joint: int) -> tuple[int, ...]:
    children = skeleton.children(joint)
    return children + tuple(j for child in children for j in _below(skeleton, child))


def reach(
    hip: Points, knee: Points, ankle: Points, goal: Points, ahead: Points
) -> tuple[Points, Points]:
    """Returns knee and ankle, the ankle at its goal or as near as the leg reaches.

    Args:
        hip: New position of the hip.
        knee: Old position of the knee, moved with the hip.
        ankle: Old position of the ankle, moved with the hip.
        goal: Wanted position of the ankle.
        ahead: Direction in which knees bend.
    """
    thigh, shank = _norm(knee - hip), _norm(ankle - knee)
    axis = unit(goal - hip)
    distance = np.clip(_norm(goal - hip), np.abs(thigh - shank) + 1e-6, thigh + shank)
    along = (thigh**2 - shank**2 + distance**2) / (2 * distance)
    radius = np.sqrt(np.maximum(thigh**2 - along**2, 0))
    before = unit(ankle - hip)
    bend = (knee - hip) - before * _dot(before, knee - hip)
    turned = quaternion_rotate(quaternion_between(before, axis), bend)
    more = np.maximum(radius - _norm(bend), 0)
    side = turned + 2 * more * unit(ahead - axis * _dot(axis, ahead))
    side = side + 1e-6 * np.cross(axis, np.roll(axis, 1, axis=-1) * (1, -1, 1))
    side = unit(side - axis * _dot(axis, side))
    return hip + axis * along + side * radius, hip + axis * distance


def _dot(a: Points, b: Points) -> Float[np.ndarray, "frames 1"]:
    return (a * b).sum(-1, keepdims=True)


def keep_knee_direction(moved: Joints, joints: Joints, skeleton: Skeleton) -> Joints:
    """Returns the moved joints, knees rotated about the line from hip to ankle where they must.

    Args:
        moved: Joints after a step of the clean-up.
        joints: The same joints before it.
        skeleton: The skeleton, which defines the legs.
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
        turned = ahead * least + unit(aside) * room
        wrong = (after < least) & (_norm(bend) > np.abs(least))
        kept[:, leg.knee] += np.where(wrong, turned - bend, 0)
    return kept


def _bend(
    leg: Float[np.ndarray, "frames 3 3"], across: Points
) -> tuple[Float[np.ndarray, "frames 1"], Points, Points]:
    """Returns how far the knee is ahead of the line hip–ankle, that direction, and its offset."""
    hip, knee, ankle = np.moveaxis(leg, 1, 0)
    axis = unit(hip - ankle)
    ahead = unit(np.cross(across, axis))
    bend = knee - hip
    bend = bend - axis * (bend * axis).sum(axis=-1, keepdims=True)
    return (bend * ahead).sum(axis=-1, keepdims=True), ahead, bend


def _norm(vectors: Points) -> Float[np.ndarray, "frames 1"]:
    return np.linalg.norm(vectors, axis=-1, keepdims=True)
