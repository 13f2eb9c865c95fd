"""Defects of motion capture: glitches that no body makes, and calibration poses.

Accelerations are second differences at the data set's 20 frames per second, so a jump of d meters
from one frame to the next reads 400 d m/s². In CMU's and HDM05's clips the clean ones stay below
195 m/s² (dribbling, punches, kicks) and the glitchy ones begin at 288; for the pelvis 46 and 107.

Conversions of CMU to BVH put a T-pose before the motion and blend the first frames with it.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import unit
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Joints
from latentmotion.measure.signals import spans

ANY_JOINT = 240.0  # Largest credible acceleration of any joint, m/s².
PELVIS = 75.0  # Largest credible acceleration of the pelvis, m/s².
PELVIS_SPEED = 11.0  # Largest credible speed of the pelvis, m/s; a sprinter's is 10 to 12.
BONE_CHANGE = 0.35  # Largest credible change of a bone's length, as a fraction of its median.
LEG = (0.3, 1.5)  # Credible lengths of hip to ankle, meters.

MARGIN = 2  # Frames on either side of a glitch that are cut out with it.

# Frames of a BVH file after the T-pose that may be drawn towards it, at the native rate.
BLENDED = 6
# Largest mean rotation of the joints in a T-pose, degrees. In the conversions of CMU it is 1.1 to
# 2.8; the motions themselves begin at 7 to 32.
REST = 4.0
# Rotation of the frame after the T-pose, as a fraction of that when the blend is over, below which
# there is a blend. 0.3 to 0.65 in the Daz-friendly conversion, which blends, and 0.99 in the other,
# which does not.
BLENDS = 0.8

HELD = 8  # Frames of a calibration pose in the middle of a take; arms pass through it faster.
EDGE = 5  # Frames from the start or end of a take within which it may be shorter.
LOWERING = 10  # Frames in which the arms go down from it, or up to it.

_PELVIS, _LEG_BONES = 0, (4, 7)


def find_glitch(joints: Joints, fps: float) -> str | None:
    """Returns why a motion of HumanML3D's joints cannot be real, or None if it can.

    Args:
        joints: Joint positions, meters, at least three frames.
        fps: Frames per second.
    """
    finite = np.isfinite(joints).all(axis=(1, 2))
    if not finite.all():
        return f"joints that are not finite in frame {int(np.argmin(finite))}"
    if reason := _wrong_size(joints):
        return reason
    lengths, change = _bone_lengths(joints), _length_changes(joints, joints)
    frame, joint = np.unravel_index(change.argmax(), change.shape)
    if not change[frame, joint] <= BONE_CHANGE:
        return (
            f"the bone to {HUMANML3D.names[joint]} is {lengths[frame, joint]:.2f} m long in frame "
            f"{frame} and {np.median(lengths, axis=0)[joint]:.2f} m as a rule"
        )
    speed = np.linalg.norm(np.diff(joints[:, _PELVIS], axis=0), axis=-1) * fps
    if speed.max() > PELVIS_SPEED:
        return f"the body moves at {speed.max():.0f} m/s in frame {speed.argmax()}"
    acceleration = np.linalg.norm(np.diff(joints, n=2, axis=0), axis=-1) * fps**2
    for checked, largest in ((acceleration[:, : _PELVIS + 1], PELVIS), (acceleration, ANY_JOINT)):
        frame, joint = np.unravel_index(checked.argmax(), checked.shape)
        if checked[frame, joint] > largest:
            name = HUMANML3D.names[joint]
            return f"{name} jumps in frame {frame + 1} ({checked[frame, joint]:.0f} m/s²)"
    return None


def clean_spans(joints: Joints, fps: float) -> list[tuple[int, int]]:
    """Returns the stretches between glitches, as first frame and one past the last.

    Around every frame in which something jumps or tears, `MARGIN` frames go too. A motion of the
    wrong size has no clean stretch.

    Args:
        joints: Joint positions, meters.
        fps: Frames per second.
    """
    bad = np.logical_not(np.isfinite(joints).all(axis=(1, 2)))
    joints = np.where(bad[:, None, None], 0.0, joints)
    if len(joints) < 3 or bad.all() or _wrong_size(joints[~bad]):
        return []
    speed = np.linalg.norm(np.diff(joints[:, _PELVIS], axis=0), axis=-1) * fps
    acceleration = np.linalg.norm(np.diff(joints, n=2, axis=0), axis=-1) * fps**2
    jumps = (acceleration.max(1) > ANY_JOINT) | (acceleration[:, _PELVIS] > PELVIS)
    bad |= _length_changes(joints[~bad], joints).max(1) > BONE_CHANGE
    bad[1:] |= speed > PELVIS_SPEED
    bad[1:-1] |= jumps
    near = np.convolve(bad, np.ones(2 * MARGIN + 1), "same") > 0
    return list(spans(~near))


def begins_with_t_pose(animation: Animation, least: float = 0.0) -> bool:
    """Returns whether frame 0 is the skeleton's rest pose and later frames are far from it.

    Args:
        animation: Any skeleton.
        least: Degrees by which the motion is away from the rest pose at least.
    """
    degrees = _degrees_from_rest(animation)
    return bool(
        len(degrees) > BLENDED
        and degrees[0] < REST
        and degrees[BLENDED] > max(2 * degrees[0], least)
    )


def is_blended(animation: Animation) -> bool:
    """Returns whether the frames after the T-pose are drawn towards it."""
    degrees = _degrees_from_rest(animation)
    return bool(degrees[1] < BLENDS * degrees[BLENDED])


def without_blend(joints: Joints, native: float, fps: float) -> Joints:
    """Replaces the frames next to the T-pose by a straight continuation of what follows.

    Args:
        joints: HumanML3D's joints at `fps`, without the T-pose itself.
        native: Frames per second of the file.
        fps: Frames per second of `joints`.
    """
    count = math.ceil(BLENDED * fps / native)
    if len(joints) < count + 2:
        return joints
    step = joints[count + 1] - joints[count]
    straight = joints[count] + np.arange(-count, 0)[:, None, None] * step
    replaced = straight.copy()
    for joint, parent in list(enumerate(HUMANML3D.parents))[1:]:
        bone = straight[:, joint] - straight[:, parent]
        length = np.linalg.norm(joints[count, joint] - joints[count, parent])
        replaced[:, joint] = replaced[:, parent] + length * unit(bone)
    return np.concatenate([replaced, joints[count:]])


def held_t_pose(joints: Joints) -> Bool[np.ndarray, " frames"]:
    """Returns in which frames a performer stands with both arms stretched out to the sides.

    Captures often begin and end so, for calibration.

    Args:
        joints: HumanML3D's joints.
    """
    index = HUMANML3D.names.index
    across = unit(joints[:, index("left_shoulder")] - joints[:, index("right_shoulder")])
    is_t_pose = np.ones(len(joints), bool)
    for side, sign in (("left", 1), ("right", -1)):
        shoulder, elbow, wrist, hip, ankle = (
            joints[:, index(f"{side}_{name}")]
            for name in ("shoulder", "elbow", "wrist", "hip", "ankle")
        )
        upper, lower = unit(elbow - shoulder), unit(wrist - elbow)
        # A T-pose as people hold it: elbows bent by less than 35 degrees, arms within 30 degrees of
        # level and 40 degrees of sideways.
        is_t_pose &= np.sum(upper * lower, axis=-1) > np.cos(np.radians(35))
        is_t_pose &= np.abs(unit(wrist - shoulder)[:, 1]) < np.sin(np.radians(30))
        is_t_pose &= sign * np.sum(unit(wrist - shoulder) * across, axis=-1) > np.cos(
            np.radians(40)
        )
        is_t_pose &= unit(hip - ankle)[:, 1] > np.cos(np.radians(20))
    return is_t_pose


def without_t_poses(joints: Joints) -> list[tuple[int, int]]:
    """Returns the stretches without calibration poses and the motion into and out of them."""
    posed = np.zeros(len(joints), bool)
    for first, last in spans(held_t_pose(joints)):
        at_edge = first < EDGE or last > len(joints) - EDGE
        if last - first >= HELD or at_edge:
            posed[max(0, first - LOWERING) : last + LOWERING] = True
    return list(spans(~posed))


def _wrong_size(joints: Joints) -> str | None:
    leg = float(np.median(_bone_lengths(joints)[:, _LEG_BONES], axis=0).sum())
    if LEG[0] <= leg <= LEG[1]:
        return None
    return f"legs {leg:.3g} m long; check the unit of length"


def _length_changes(
    usual: Float[np.ndarray, "some joints 3"], joints: Joints
) -> Float[np.ndarray, "frames joints"]:
    """Returns by how much the bones differ from their usual lengths, as a fraction of these."""
    median = np.median(_bone_lengths(usual), axis=0)
    # Bones of a few centimeters (spine, collars) change by much and mean little.
    return np.abs(_bone_lengths(joints) - median) / np.maximum(median, 0.1)


def _bone_lengths(joints: Joints) -> Float[np.ndarray, "frames joints"]:
    parents = [max(parent, 0) for parent in HUMANML3D.parents]
    return np.linalg.norm(joints - joints[:, parents], axis=-1)


def _degrees_from_rest(animation: Animation) -> Float[np.ndarray, " frames"]:
    """Returns the mean rotation of the joints from the rest pose in the first frames, degrees."""
    rotations = animation.rotations[: BLENDED + 1]
    cosines = (np.trace(rotations, axis1=-2, axis2=-1) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean(axis=1)
