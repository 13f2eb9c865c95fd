"""Physical plausibility: foot sliding, jitter, floor penetration, floating.

Foot sliding: how fast feet move along the floor while they stand on it.

    mean over foot joints j and steps t of   v_jt · max(0, 2 − 2^(h_jt / H)),   H = 2.5 cm

v is the horizontal speed, h the height above the floor: a joint on the floor counts in full, one
2.5 cm above it not at all. Zhang et al. 2018, "Mode-adaptive neural networks for quadruped motion
control", section 8.

    skating ratio: share of steps in which a foot moves more than 2.5 cm while below 5 cm,

Karunratanakul et al. 2023, "Guided motion diffusion", section 5, at the 20 frames per second of
HumanML3D; here as a speed, 0.5 m/s, so that it does not depend on the frame rate.

Jitter: how much joints shake, as the mean size of their jerk.

    mean over joints j and frames t of   |p_{t+3} − 3 p_{t+2} + 3 p_{t+1} − p_t| · fps³,   m/s³

Flash and Hogan 1985 (minimum jerk); used so by Yi et al. 2021, "TransPose", section 5.

Floor penetration: how deep the lowest joint is below the floor.

    mean over frames t of   max(0, floor − min_j y_jt),   meters

Yuan et al. 2023, "PhysDiff", section 4, with joints in place of a body mesh.

Floating: how high a body is that nothing carries, as far as it neither travels nor falls.

    mean over frames t of   max(0, min_j y_jt − 5 cm)   where the pelvis is slower than 0.3 m/s, or
                                                        t is the first or the last frame

PhysDiff, section 4, has all frames; one who jumps or runs is in the air by right. A motion that
begins or ends there is not: the frames at its ends count as a quarter of a second each.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import length
from latentmotion.kinematics.skeleton import HUMANML3D, Joints, Skeleton

_FADING_HEIGHT = 0.025
_CONTACT_HEIGHT, _SKATING_SPEED = 0.05, 0.5
_CARRIED_SPEED, _END_SECONDS = 0.3, 0.25
_LIFTED, _UP = 0.2, 0.6


def foot_sliding(
    joints: Joints, fps: float, skeleton: Skeleton = HUMANML3D, floor: float = 0.0
) -> float:
    """Returns the mean sliding speed of the feet, m/s; 0 for a single frame.

    Args:
        joints: Joint positions, meters, y up.
        fps: Frames per second.
        skeleton: Says which joints are feet.
        floor: Height of the floor, meters.
    """
    speed, height = _steps(joints, fps, skeleton, floor)
    weight = np.clip(2 - 2 ** (height / _FADING_HEIGHT), 0, 1)
    return float((speed * weight).mean()) if speed.size else 0.0


def skating_ratio(
    joints: Joints, fps: float, skeleton: Skeleton = HUMANML3D, floor: float = 0.0
) -> float:
    """Returns the share of steps in which a foot skates, from 0 to 1."""
    speed, height = _steps(joints, fps, skeleton, floor)
    skates = (speed > _SKATING_SPEED) & (height < _CONTACT_HEIGHT)
    return float(skates.any(axis=1).mean()) if len(speed) else 0.0


def _steps(
    joints: Joints, fps: float, skeleton: Skeleton, floor: float
) -> tuple[Float[np.ndarray, "steps feet"], Float[np.ndarray, "steps feet"]]:
    """Returns horizontal speed, m/s, and the greater height of both ends, of each step."""
    feet = np.asarray(joints, dtype=np.float64)[:, [*skeleton.left_foot, *skeleton.right_foot]]
    speed = length(np.diff(feet[..., [0, 2]], axis=0)) * fps
    height = feet[..., 1] - floor
    return speed, np.maximum(height[1:], height[:-1])


def jitter(joints: Joints, fps: float) -> float:
    """Returns the mean jerk of the joints, m/s³; 0 for fewer than four frames.

    Args:
        joints: Joint positions, meters.
        fps: Frames per second.
    """
    jerk = np.diff(np.asarray(joints, dtype=np.float64), n=3, axis=0) * fps**3
    return float(length(jerk).mean()) if len(jerk) else 0.0


def penetration(joints: Joints, floor: float = 0.0) -> float:
    """Returns the mean depth of the lowest joint below the floor, meters.

    Args:
        joints: Joint positions, meters, y up.
        floor: Height of the floor, meters.
    """
    lowest = np.asarray(joints, dtype=np.float64)[..., 1].min(axis=1)
    return float(np.maximum(0, floor - lowest).mean())


def unfinished(joints: Joints, skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, " frames"]:
    """Returns how far from standing each pose is as an end of a motion, meters.

    It is how high the body is above the floor, and half of how high one who is up lifts a foot.

    Args:
        joints: Joint positions, meters, y up; joint 0 is the root.
        skeleton: Says which joints are feet.
    """
    heights = np.asarray(joints, dtype=np.float64)[..., 1]
    lowest = heights.min(axis=1)
    flight = np.maximum(0, lowest - _CONTACT_HEIGHT)
    if not (skeleton.left_foot and skeleton.right_foot):
        return flight
    feet = [
        heights[:, list(foot)].min(axis=1) for foot in (skeleton.left_foot, skeleton.right_foot)
    ]
    lifted = np.maximum(0, np.maximum(*feet) - lowest - _LIFTED)
    return flight + 0.5 * np.where(heights[:, 0] - lowest > _UP, lifted, 0.0)


def floating(joints: Joints, fps: float) -> float:
    """Returns the mean height of a body that nothing carries, meters.

    Args:
        joints: Joint positions, meters, y up; joint 0 is the root.
        fps: Frames per second.
    """
    exact = np.asarray(joints, dtype=np.float64)
    height = np.maximum(0, exact[..., 1].min(axis=1) - _CONTACT_HEIGHT)
    if len(exact) < 2:
        return float(height.mean())
    slow = length(np.gradient(exact[:, 0], 1 / fps, axis=0)) < _CARRIED_SPEED
    weight = slow.astype(np.float64)
    weight[[0, -1]] = _END_SECONDS * fps
    return float((weight * height).sum() / len(exact))
