"""Hands that reach through the floor are put onto it: shoulder and elbow bend for them, outward."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.leg_ik import reach
from latentmotion.cleanup.smoothing import upper_envelope
from latentmotion.kinematics.skeleton import Skeleton

_ARM = ("shoulder", "elbow", "wrist")


def find_arms(skeleton: Skeleton) -> list[tuple[int, int, int]]:
    """Returns shoulder, elbow and wrist of both arms, as far as the skeleton has them."""
    place = {name: joint for joint, name in enumerate(skeleton.names)}
    sides = [[f"{side}_{name}" for name in _ARM] for side in ("left", "right")]
    found = [[place[name] for name in side] for side in sides if set(side) <= set(place)]
    return [(shoulder, elbow, wrist) for shoulder, elbow, wrist in found]


def lift_hands(
    joints: Float[np.ndarray, "frames joints 3"], fps: float, skeleton: Skeleton
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns the joints with no wrist below the floor at height 0."""
    moved, arms = joints.copy(), find_arms(skeleton)
    if not arms:
        return moved
    between = np.mean([joints[:, arm[0]] for arm in arms], axis=0)
    for arm in arms:
        shoulder, elbow, wrist = (joints[:, joint] for joint in arm)
        up = upper_envelope(np.maximum(0, -wrist[:, 1]), max(1, round(0.1 * fps)))
        goal = wrist + up[:, None] * (0, 1, 0)
        outward = elbow - (shoulder + wrist) / 2 + 0.1 * (shoulder - between)
        new = reach(shoulder, elbow, wrist, goal, outward)
        touched = (up > 0)[:, None]
        for joint, old, position in zip(arm[1:], (elbow, wrist), new, strict=True):
            moved[:, joint] = np.where(touched, position, old)
    return moved
