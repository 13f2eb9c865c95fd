"""Legs of a skeleton: which joints hang between pelvis and toes, found from its feet."""

from __future__ import annotations

from dataclasses import dataclass

from latentmotion.kinematics.skeleton import Skeleton


@dataclass(frozen=True)
class Leg:
    """One leg, by joint indices."""

    hip: int
    knee: int
    ankle: int
    below: tuple[int, ...]
    """Joints that hang on the ankle: heel, toes."""
    pivots: tuple[int, ...]
    """Joints that touch the floor, the one that holds longest last."""


def find_legs(skeleton: Skeleton) -> list[Leg]:
    """Returns the legs, left and right; none where the skeleton names no feet or has no knees."""
    found = [_leg(skeleton, foot) for foot in (skeleton.left_foot, skeleton.right_foot) if foot]
    return [leg for leg in found if leg is not None]


def _leg(skeleton: Skeleton, foot: tuple[int, ...]) -> Leg | None:
    chain = [foot[0]]
    while chain[-1] > 0:
        chain.append(skeleton.parents[chain[-1]])
    upper = next((n for n, j in enumerate(chain) if len(skeleton.children(j)) > 1), 0)
    if upper < 3:
        return None
    hip, knee, ankle = chain[upper - 1], chain[upper - 2], chain[upper - 3]
    return Leg(hip, knee, ankle, _below(skeleton, ankle), foot)


def _below(skeleton: Skeleton, joint: int) -> tuple[int, ...]:
    children = skeleton.children(joint)
    return children + tuple(j for child in children for j in _below(skeleton, child))
