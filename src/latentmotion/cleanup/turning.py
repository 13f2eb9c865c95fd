"""Exact turns: a motion that turns as asked, but too far or too little, turns by what was asked.

The rotation that is missing is spread over the frames in which the pelvis turns the asked way, in
proportion to how fast it does, and the path bends with it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from latentmotion.corrections import Turn
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.representation.canonical import gaussian_smooth, turn

# Share of the degrees asked that a motion turns at least; less may be no turn at all.
_LEAST = 0.5

# How many times the degrees asked a motion turns at most, and how many times up to 135°: models
# that are asked for 45° turn by 104 to 131°, which is the turn that was asked, too far.
_MOST_TIMES, _SMALL_TIMES, _SMALL = 2.0, 3.0, 135.0

# Degrees by which it may turn back; more is another turn, and which was asked is open.
_BACK = 45.0

# Degrees off that are left as they are.
_EXACT = 1.0

# Seconds by which the heading is smoothed.
_SMOOTH = 0.1

# Degrees of the smallest and the largest turn that is made exact.
_RANGE = (10.0, 1080.0)

# Share of the line between the hips that is along the floor at least; else the body lies.
_LEVEL = 0.7


def exact_turns(
    joints: Float[np.ndarray, "frames motions joints 3"],
    fps: float,
    skeleton: Skeleton,
    turns: Sequence[Turn | None],
) -> tuple[Float[np.ndarray, "frames motions joints 3"], list[float | None]]:
    """Makes motions turn by what is asked, where it is without doubt the turn that was asked.

    It is where they turn that way by half to twice as much, small angles by three times, and
    never far back.

    Args:
        joints: Positions, meters, y up; joint 0 is the root.
        fps: Frames per second.
        skeleton: Names the hips.
        turns: What is asked of each motion.

    Returns:
        The joints, and the degrees that each motion turned before, left is positive; none where
        it was left as it is.
    """
    before: list[float | None] = [None] * len(turns)
    hips = [skeleton.names.index(n) for n in ("right_hip", "left_hip") if n in skeleton.names]
    if len(hips) < 2 or len(joints) < 3 or not any(turns):
        return joints, before
    joints = joints.copy()
    for number, wish in enumerate(turns):
        if wish is not None and _RANGE[0] <= wish.degrees <= _RANGE[1]:
            track = joints[:, number]
            heading = _heading(track[:, hips[0]] - track[:, hips[1]], fps)
            total = 0.0 if heading is None else float(np.degrees(heading[-1] - heading[0]))
            wrong = (total > 0) != (wish.side == "left") if wish.side else False
            near = abs(wish.degrees - abs(total)) < _EXACT
            if heading is None or wrong or near or not _is_one_turn(heading, wish.degrees):
                continue
            rates = np.maximum(np.sign(total) * np.diff(heading), 0)
            missing = np.sign(total) * np.radians(wish.degrees - abs(total))
            added = missing * np.concatenate([[0], np.cumsum(rates / rates.sum())])
            joints[:, number] = _turned(track, added)
            before[number] = total
    return joints, before


def _is_one_turn(heading: Float[np.ndarray, " frames"], degrees: float) -> bool:
    """Whether a motion's turn is without doubt the one of so many degrees that was asked."""
    total = np.degrees(heading[-1] - heading[0])
    turned = np.degrees(heading - heading[0]) * np.sign(total)
    most = max(_MOST_TIMES * degrees, min(_SMALL_TIMES * degrees, _SMALL))
    back = float((np.maximum.accumulate(turned) - turned).max())
    return bool(_LEAST * degrees <= abs(total) <= most and back <= _BACK)


def _heading(
    across: Float[np.ndarray, "frames 3"], fps: float
) -> Float[np.ndarray, " frames"] | None:
    """Returns the heading of the line between the hips, radians; none if the body lies."""
    flat = np.hypot(across[:, 0], across[:, 2])
    if (flat < _LEVEL * np.linalg.norm(across, axis=1)).any():
        return None
    heading = np.unwrap(np.arctan2(across[:, 2], -across[:, 0]))
    return gaussian_smooth(heading[:, None], _SMOOTH * fps)[:, 0]


def _turned(
    joints: Float[np.ndarray, "frames joints 3"], angles: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames joints 3"]:
    """Turns each frame about its root, radians, and the steps of the root with it."""
    root = joints[:, :1] * np.array([1.0, 0.0, 1.0])
    steps = turn(np.diff(root, axis=0), angles[:-1, None])
    path = np.concatenate([root[:1], root[:1] + np.cumsum(steps, axis=0)])
    return turn(joints - root, angles[:, None]) + path
