"""Leg inverse kinematics: which joints are legs, and how hip and knee bend for the ankle.

Two bones. Thigh and shank keep their lengths. The knee stays on its side of the line from hip to
ankle: its offset from that line rotates with the line, and any further bend is forward. A leg whose
ankle is already at its goal does not change at all.

Knee direction. Knees bend forward: no step of the clean-up may turn one backward, or farther
backward than it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from latentmotion.arrays import cross, dot, length, perpendicular, unit
from latentmotion.kinematics.skeleton import Skeleton

Joints = Float[np.ndarray, "frames *batch joints 3"]
Points = Float[np.ndarray, "*points 3"]


@dataclass(frozen=True)
class Leg:
    """One leg, by joint indices."""

    hip: int
    knee: int
    ankle: int
    below: tuple[int, ...]  # Descendants of the ankle: heel, toes.
    pivots: tuple[int, ...]  # Joints that touch the floor, the one that holds longest last.


@lru_cache(maxsize=16)
def find_legs(skeleton: Skeleton) -> tuple[Leg, ...]:
    """Returns the legs, left and right; none if the skeleton names no feet or has no knees."""
    legs = []
    for foot in (skeleton.left_foot, skeleton.right_foot):
        chain = list(foot[:1])
        while chain and chain[-1] > 0:
            chain.append(skeleton.parents[chain[-1]])
        upper = next((n for n, j in enumerate(chain) if len(skeleton.children(j)) > 1), 0)
        if upper >= 3:
            hip, knee, ankle = chain[upper - 1], chain[upper - 2], chain[upper - 3]
            below = (j for j, line in enumerate(skeleton.lines) if ankle in line[1:])
            legs.append(Leg(hip, knee, ankle, tuple(below), foot))
    return tuple(legs)


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
    thigh, shank, away = (length(x)[..., None] for x in (knee - hip, ankle - knee, goal - hip))
    axis = (goal - hip) / np.maximum(away, 1e-12)
    distance = np.clip(away, np.abs(thigh - shank) + 1e-6, thigh + shank)
    along = (thigh**2 - shank**2 + distance**2) / np.maximum(2 * distance, 1e-12)
    radius = np.sqrt(np.maximum(thigh**2 - along**2, 0))
    before = unit(ankle - hip)
    bend = perpendicular(knee - hip, before)
    # The shortest rotation from `before` to `axis`, of a vector that is perpendicular to `before`.
    middle = before + axis
    share = dot(axis, bend) / np.maximum(1 + dot(before, axis), 1e-12)
    turned = bend - middle * share[..., None]
    more = np.maximum(radius - length(bend)[..., None], 0)
    side = turned + 2 * more * unit(perpendicular(ahead, axis))
    side = side + 1e-6 * cross(axis, axis[..., [2, 0, 1]] * (1, -1, 1))
    side = unit(perpendicular(side, axis))
    return hip + axis * along + side * radius, hip + axis * distance


def keep_knee_direction(moved: Joints, joints: Joints, skeleton: Skeleton) -> Joints:
    """Returns the moved joints, knees rotated about the line from hip to ankle where they must.

    Args:
        moved: Joints after a step of the clean-up.
        joints: The same joints before it.
        skeleton: The skeleton, which defines the legs.
    """
    legs = find_legs(skeleton)
    if len(legs) < 2 or moved is joints:
        return moved
    chains = np.array([(leg.hip, leg.knee, leg.ankle) for leg in legs]).T
    after, ahead, bend = _bend(moved, chains)
    if after.min() >= 0:
        return moved
    least = np.minimum(_bend(joints, chains)[0], 0)
    wrong = (after < least) & (length(bend)[..., None] > np.abs(least))
    if not wrong.any():
        return moved
    aside = bend - ahead * after
    room = np.sqrt(np.maximum(length(bend)[..., None] ** 2 - least**2, 0))
    turned = ahead * least + unit(aside) * room
    corrected = moved.copy()
    corrected[..., chains[1], :] += np.where(wrong, turned - bend, 0)
    return corrected


def _bend(
    joints: Joints, chains: Int[np.ndarray, "3 legs"]
) -> tuple[Float[np.ndarray, "frames *batch legs 1"], Points, Points]:
    """Returns how far knees are ahead of the line hip–ankle, that direction, and their offsets."""
    hips, knees, ankles = (joints[..., chain, :] for chain in chains)
    axis = unit(hips - ankles)
    ahead = unit(cross(hips[..., :1, :] - hips[..., 1:, :], axis))
    bend = perpendicular(knees - hips, axis)
    return dot(bend, ahead)[..., None], ahead, bend
