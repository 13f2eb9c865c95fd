"""Loops: motions whose last frame is their first, farther along their path.

Filters, foot locks and the path of the root would treat the ends of a turn as ends. So a turn is
cleaned up between turns before and after it. Feet that are held start and stop more sharply than
feet that slide; where that is at the seam, the seam is smoothed until joints accelerate there no
more than before the clean-up.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.cleanup.smoothing import gaussian
from latentmotion.kinematics.skeleton import joints_of_bones
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn

# Seconds of further turns on either side of the one that is kept.
_BESIDE = 3.0

# Seconds to either side of a seam within which it is smoothed.
_SEAM = 0.4

# Standard deviations, seconds, of the Gaussians that are tried for that, mildest first.
_DEVIATIONS = np.linspace(0.02, 0.12, 11)


def is_loop(motion: Motion) -> bool:
    """Returns whether a motion says that its last frame is its first, farther along its path."""
    return motion.metadata.get("loop") is True and len(motion) > 2


def turn_of(motion: Motion) -> tuple[float, Float[np.ndarray, " 3"]]:
    """Returns what a turn of a loop does: radians about the start, and meters along the floor."""
    first, last = motion.joints[0].astype(np.float64), motion.joints[-1].astype(np.float64)
    angle = float(heading(last, motion.skeleton) - heading(first, motion.skeleton))
    return (angle + np.pi) % (2 * np.pi) - np.pi, (last[0] - first[0]) * (1, 0, 1)


def turns_beside(motion: Motion) -> int:
    """Returns how many turns to either side a turn is cleaned up with."""
    return int(np.ceil(_BESIDE * motion.fps / (len(motion) - 1)))


def unrolled(motion: Motion, before: int, after: int) -> Motion:
    """Returns a loop with turns before and after its own, which stays where it is.

    Args:
        motion: One turn.
        before: Turns before it.
        after: Turns after it.
    """
    angle, step = turn_of(motion)
    cycle, start = motion.joints[:-1].astype(np.float64), motion.joints[0, 0] * (1.0, 0.0, 1.0)
    places = {0: start}
    for number in range(1, max(before, after) + 1):
        places[number] = places[number - 1] + turn(step, np.array((number - 1) * angle))
        places[-number] = places[1 - number] - turn(step, np.array(-number * angle))
    turns = [
        turn(cycle - start, np.array(number * angle)) + places[number]
        for number in range(-before, after + 1)
    ]
    about = {name: it for name, it in motion.metadata.items() if name != "loop"}
    return replace(motion, joints=np.concatenate(turns).astype(np.float32), metadata=about)


def rolled_up(whole: Motion, motion: Motion) -> Motion:
    """Returns the turn in the middle of what `unrolled` made of a loop, with its closing frame.

    Its seam is smoothed until it accelerates by no more than before.

    Args:
        whole: As many turns before as after the one that is kept, or one less after it.
        motion: The loop as it was.
    """
    count = len(motion) - 1
    first = turns_beside(motion) * count
    joints = whole.joints[first : first + count + 1]
    loop = replace(motion, joints=joints, metadata={**whole.metadata, "loop": True})
    skeleton, most = loop.skeleton, seam_acceleration(motion)
    beside = unrolled(loop, 1, 1).joints.astype(np.float64)
    bones = beside[:, 1:] - beside[:, list(skeleton.parents[1:])]
    lengths = np.linalg.norm(bones, axis=-1, keepdims=True)
    away = np.abs((np.arange(len(beside)) + count // 2) % count - count // 2)
    near = np.clip(1 - away / (_SEAM * loop.fps), 0, 1)[:, None, None]
    near, smoothed = near**2 * (3 - 2 * near), loop
    for deviation in _DEVIATIONS * loop.fps:
        if seam_acceleration(smoothed) <= most:
            break
        root, ways = (x + near * (gaussian(x, deviation) - x) for x in (beside[:, :1], bones))
        joints = joints_of_bones(root[:, 0], lengths * unit(ways), skeleton)
        joints = joints[count : 2 * count + 1].astype(np.float32)
        smoothed = replace(loop, joints=joints)
    return smoothed


def seam_acceleration(loop: Motion) -> float:
    """Returns the greatest acceleration of a joint at a seam, seen from the body, m/s²."""
    joints, count = unrolled(loop, 1, 1).joints.astype(np.float64), len(loop) - 1
    facing = np.unwrap(heading(joints, loop.skeleton))
    around = turn(joints - joints[:, :1] * (1, 0, 1), -facing[:, None])[count - 3 : count + 4]
    return float(np.linalg.norm(np.diff(around, n=2, axis=0), axis=-1).max()) * loop.fps**2
