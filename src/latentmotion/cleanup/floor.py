"""Floor: standing feet are at height 0, and no body sinks in or hovers.

1. The whole motion is shifted by one number if the feet of an upright body stand far from 0.
2. Where the lowest joint hovers for longer than any jump lasts, the body is lowered. A body that
   lies (pelvis low) may hover a little, for its flesh; one that does not and is as high as a step
   of stairs stands on something, if it began lower.
3. Where the body is below the floor, it is lifted; feet are lifted by their own legs, hands by
   their arms. A jump, a ladder, a flight of stairs are left as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import quantile
from latentmotion.cleanup.contacts import ramp, velocity
from latentmotion.cleanup.leg_ik import reach
from latentmotion.cleanup.smoothing import gaussian, upper_envelope
from latentmotion.kinematics.skeleton import Skeleton

_ARM = ("shoulder", "elbow", "wrist")


@dataclass(frozen=True)
class Floor:
    """Settings of the floor's height."""

    tolerance: float = 0.03
    """Meters that standing feet may be off the floor, as they are in motion capture."""
    lying: tuple[float, float] = (0.25, 0.4)
    """Heights of the pelvis, meters, below which a body lies and above which it does not."""
    hover: float = 0.1
    """Meters that the lowest joint of a lying body may be above the floor, for its flesh."""
    step: tuple[float, float] = (0.12, 0.17)
    """Meters that the lowest joint of another body may be above the floor: below the first it
    hovers, above the second it stands on something."""
    longest_jump: float = 1.2
    """Seconds that a body may be in the air."""
    sink: float = 0.04
    """Meters that feet may be below the floor for legs to lift them alone."""


def align_floor(
    joints: Float[np.ndarray, "frames *batch joints 3"],
    fps: float,
    skeleton: Skeleton,
    settings: Floor = Floor(),
) -> Float[np.ndarray, "frames *batch joints 3"]:
    """Returns the joints, whole poses moved up or down so that they stand or lie on height 0."""
    feet = [*skeleton.left_foot, *skeleton.right_foot]
    hands = [joint for arm in find_arms(skeleton) for joint in arm[2:]]
    body = [joint for joint in range(len(skeleton)) if joint not in (*feet, *hands)]
    moved = joints.copy()
    low, high = settings.lying
    if feet:  # 1. one number, the height under standing feet
        lowest = moved[..., feet, 1].min(axis=-1)
        stands = moved[..., 0, 1] - lowest > high
        stands &= np.abs(velocity(lowest, fps)) < 0.1
        columns = zip(
            lowest.reshape(len(lowest), -1).T, stands.reshape(len(lowest), -1).T, strict=True
        )
        under = [heights[still] for heights, still in columns]
        level = np.array([quantile(heights, 0.1) if len(heights) else 0.0 for heights in under])
        level = level.reshape(lowest.shape[1:])
        shift = np.sign(level) * np.maximum(0, np.abs(level) - settings.tolerance)
        moved[..., 1] -= shift[..., None]
    # 2. A body comes down by what it hovers for longer than a jump lasts.
    lies = np.maximum(0, np.minimum(1, (high - moved[..., 0, 1]) / (high - low)))
    reach, last = min(round(settings.longest_jump * fps / 2), len(moved) - 1), len(moved) - 1
    around = np.clip(np.arange(-reach, last + reach + 1), 0, last)
    lowest = moved[..., 1].min(axis=-1)[around]
    base = np.lib.stride_tricks.sliding_window_view(lowest, 2 * reach + 1, axis=0).min(axis=-1)
    climbed = np.logical_or.accumulate(moved[..., 1].min(axis=-1) < settings.step[0], axis=0)
    stands_on = climbed * ramp(base, *settings.step)
    hover = lies * np.maximum(0, base - settings.hover)
    hover += (1 - lies) * (1 - stands_on) * np.maximum(0, base - settings.tolerance)
    if hover.any():
        moved[..., 1] -= np.maximum(0, gaussian(hover, 0.2 * fps))[..., None]
    # 3. What is below the floor is lifted.
    below = np.maximum(0, -moved[..., body, 1].min(axis=-1))
    if feet:
        below = np.maximum(below, -settings.sink - moved[..., feet, 1].min(axis=-1))
    moved[..., 1] += upper_envelope(below, max(1, round(0.2 * fps)))[..., None]
    return lift_hands(moved, fps, skeleton)


@lru_cache(maxsize=16)
def find_arms(skeleton: Skeleton) -> tuple[tuple[int, int, int], ...]:
    """Returns shoulder, elbow and wrist of both arms, as far as the skeleton has them."""
    index = {name: joint for joint, name in enumerate(skeleton.names)}
    sides = [[f"{side}_{name}" for name in _ARM] for side in ("left", "right")]
    arms = [[index[name] for name in side] for side in sides if set(side) <= set(index)]
    return tuple((shoulder, elbow, wrist) for shoulder, elbow, wrist in arms)


def lift_hands(
    joints: Float[np.ndarray, "frames *batch joints 3"], fps: float, skeleton: Skeleton
) -> Float[np.ndarray, "frames *batch joints 3"]:
    """Returns the joints with no wrist below the floor at height 0."""
    arms = np.array(find_arms(skeleton), int).reshape(-1, 3)
    shoulder, elbow, wrist = (joints[..., arms[:, n], :] for n in range(3))
    below = np.maximum(0, -wrist[..., 1])
    moved = joints.copy()
    if not below.any():
        return moved
    up = upper_envelope(below, max(1, round(0.1 * fps)))[..., None]
    between = shoulder.mean(axis=-2, keepdims=True)
    outward = elbow - (shoulder + wrist) / 2 + 0.1 * (shoulder - between)
    new = reach(shoulder, elbow, wrist, wrist + up * (0, 1, 0), outward)
    for n, old, position in zip((1, 2), (elbow, wrist), new, strict=True):
        moved[..., arms[:, n], :] = np.where(up > 0, position, old)
    return moved
