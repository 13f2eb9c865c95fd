"""Layers: what arms and head do over what the body does beneath, as game engines mask animations.

    arm and head joints, in the frame of the chest:  the gesture's, by how far the arm is raised
    all other joints:                                of the body that walks, sits or kneels

No clip shows an apple that is eaten on the way; one shows the apple, noise makes the way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import unit

Joints = Float[np.ndarray, "frames joints 3"]

# Meters that the pelvis, and an ankle, rises in a gesture at most: what a step does.
_RISE, _STEP = 0.15, 0.25

_RISEN = 0.03  # Meters above its lowest place at which a pelvis begins to rise from a seat.

# Height of the pelvis over the ankles, as a share of a leg's length, from which a body is upright.
_UPRIGHT = 0.8

# Meters from a hanging arm's place up to which a hand does nothing, and from which it is raised.
_HANGS, _RAISED = 0.18, 0.35

# Frames over which an arm goes from swinging along to its gesture: 0.25 s at 20 a second.
_EASE = 5


def is_gesture(joints: Joints, names: Sequence[str]) -> bool:
    """Whether legs stand or walk while arms or head move.

    Args:
        joints: Of a clip, meters.
        names: Of the joints.
    """
    ankles, pelvis = _heights(joints, names)
    level = np.ptp(pelvis) < _RISE and np.ptp(ankles, axis=0).max() < _STEP
    return bool(level and stands(joints, names).all())


def stands(joints: Joints, names: Sequence[str]) -> Bool[np.ndarray, " frames"]:
    """Whether a body is upright on its legs, rather than sitting, kneeling or lying."""
    ankles, pelvis = _heights(joints, names)
    leg = joints[:, [names.index(f"left_{part}") for part in ("hip", "knee", "ankle")]]
    length = np.linalg.norm(np.diff(leg, axis=1), axis=-1).sum(axis=1).max()
    return pelvis - ankles.min(axis=1) > _UPRIGHT * length


def lowest(body: Joints, names: Sequence[str]) -> int:
    """Returns the last frame before a body rises from where its pelvis is lowest."""
    heights = body[:, names.index("pelvis"), 1]
    return int(np.flatnonzero(heights < heights.min() + _RISEN)[-1])


def layered(under: Joints, over: Joints, names: Sequence[str]) -> Joints:
    """Returns a body whose raised arms and head move as those of another.

    Args:
        under: What the body does, meters.
        over: A gesture, as many frames.
        names: Of the joints.
    """
    body, neck = under.copy(), names.index("neck")
    chest, other = _chest(under, names), _chest(over, names)

    def placed(parts: Sequence[int]) -> Joints:
        offsets = np.einsum("fab,fjb->fja", other, over[:, parts] - over[:, [neck]])
        return under[:, [neck]] + np.einsum("fba,fjb->fja", chest, offsets)

    head = names.index("head")
    body[:, [head]] = placed([head])
    for side in ("left", "right"):
        arm = [names.index(f"{side}_{part}") for part in ("shoulder", "elbow", "wrist")]
        shoulder, elbow, wrist = over[:, arm].swapaxes(0, 1)
        length = np.linalg.norm(elbow - shoulder, axis=1) + np.linalg.norm(wrist - elbow, axis=1)
        hanging = shoulder - length[:, None] * (0, 1, 0)
        raised = np.linalg.norm(wrist - hanging, axis=1)
        share = np.clip((raised - _HANGS) / (_RAISED - _HANGS), 0, 1)
        padded = np.pad(share, _EASE, mode="edge")
        share = np.convolve(padded, np.ones(2 * _EASE + 1) / (2 * _EASE + 1), mode="valid")
        share = share[:, None, None]
        body[:, arm] = share * placed(arm) + (1 - share) * under[:, arm]
    return body


def _heights(
    joints: Joints, names: Sequence[str]
) -> tuple[Float[np.ndarray, "frames 2"], Float[np.ndarray, " frames"]]:
    """Returns the heights of both ankles and of the pelvis, meters."""
    ankles = [names.index(f"{side}_ankle") for side in ("left", "right")]
    return joints[:, ankles, 1], joints[:, names.index("pelvis"), 1]


def _chest(joints: Joints, names: Sequence[str]) -> Float[np.ndarray, "frames 3 3"]:
    """Returns the axes of the chest: to the left, up and forward, as rows."""
    left, right, neck, spine = (
        joints[:, names.index(name)] for name in ("left_collar", "right_collar", "neck", "spine2")
    )
    up = unit(neck - spine)
    across = left - right
    across = unit(across - (across * up).sum(axis=1, keepdims=True) * up)
    return np.stack([across, up, np.cross(across, up)], axis=1)
