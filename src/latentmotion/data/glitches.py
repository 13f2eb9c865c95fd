"""Motions that no body makes: marker swaps, jumps, torn bones, wrong units.

Accelerations are second differences at the data set's 20 frames per second, so a jump of d meters
from one frame to the next reads 400 d m/s². In CMU's and HDM05's clips the clean ones stay below
195 m/s² (dribbling, punches, kicks) and the glitchy ones begin at 288; for the pelvis 46 and 107.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.skeleton import HUMANML3D

ANY_JOINT = 240.0
"""Largest credible acceleration of any joint, m/s²."""
PELVIS = 75.0
"""Largest credible acceleration of the pelvis, m/s²."""
PELVIS_SPEED = 11.0
"""Largest credible speed of the pelvis, m/s; a sprinter's is 10 to 12."""
BONE_CHANGE = 0.35
"""Largest credible change of a bone's length, as a part of its median."""
LEG = (0.3, 1.5)
"""Credible lengths of hip to ankle, meters."""

MARGIN = 2
"""Frames on either side of a glitch that are cut out with it."""

_PELVIS, _LEG_BONES = 0, (4, 7)


def find_glitch(joints: Float[np.ndarray, "frames joints 3"], fps: float) -> str | None:
    """Returns why a motion of HumanML3D's joints cannot be real, or None if it can.

    Args:
        joints: Joint positions, meters, at least three frames.
        fps: Frames per second.
    """
    if not np.isfinite(joints).all():
        frame = int(np.argmin(np.isfinite(joints).all(axis=(1, 2))))
        return f"joints that are not finite in frame {frame}"
    for problem in (_wrong_size, _torn_bone):
        if reason := problem(joints):
            return reason
    return _jump(joints, fps)


def clean_spans(joints: Float[np.ndarray, "frames joints 3"], fps: float) -> list[tuple[int, int]]:
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
    change = np.linalg.norm(np.diff(joints, n=2, axis=0), axis=-1) * fps**2
    jumps = (change.max(1) > ANY_JOINT) | (change[:, _PELVIS] > PELVIS)
    bad |= _changes(joints[~bad], joints).max(1) > BONE_CHANGE
    bad[1:] |= speed > PELVIS_SPEED
    bad[1:-1] |= jumps
    near = np.convolve(bad, np.ones(2 * MARGIN + 1), "same") > 0
    edges = np.flatnonzero(np.diff(np.concatenate([[True], near, [True]]).astype(int)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _wrong_size(joints: Float[np.ndarray, "frames joints 3"]) -> str | None:
    leg = float(np.median(_bones(joints)[:, _LEG_BONES], axis=0).sum())
    if LEG[0] <= leg <= LEG[1]:
        return None
    return f"legs {leg:.3g} m long; check the unit of length"


def _torn_bone(joints: Float[np.ndarray, "frames joints 3"]) -> str | None:
    lengths, change = _bones(joints), _changes(joints, joints)
    usual = np.median(lengths, axis=0)
    frame, joint = np.unravel_index(change.argmax(), change.shape)
    if change[frame, joint] <= BONE_CHANGE:
        return None
    return (
        f"the bone to {HUMANML3D.names[joint]} is {lengths[frame, joint]:.2f} m long in frame "
        f"{frame} and {usual[joint]:.2f} m as a rule"
    )


def _jump(joints: Float[np.ndarray, "frames joints 3"], fps: float) -> str | None:
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=-1) * fps
    change = np.linalg.norm(np.diff(joints, n=2, axis=0), axis=-1) * fps**2
    fastest = speed[:, _PELVIS].max()
    if fastest > PELVIS_SPEED:
        return f"the body moves at {fastest:.0f} m/s in frame {speed[:, _PELVIS].argmax()}"
    if change[:, _PELVIS].max() > PELVIS:
        return _told(change[:, _PELVIS, None], ("pelvis",))
    if change.max() > ANY_JOINT:
        return _told(change, HUMANML3D.names)
    return None


def _changes(
    usual: Float[np.ndarray, "some joints 3"], joints: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, "frames joints"]:
    """Returns by how much the bones differ from their usual lengths, as a part of these."""
    median = np.median(_bones(usual), axis=0)
    # Bones of a few centimeters (spine, collars) change by much and mean little.
    return np.abs(_bones(joints) - median) / np.maximum(median, 0.1)


def _told(change: Float[np.ndarray, "frames joints"], names: tuple[str, ...]) -> str:
    frame, joint = np.unravel_index(change.argmax(), change.shape)
    return f"{names[joint]} jumps in frame {frame + 1} ({change[frame, joint]:.0f} m/s²)"


def _bones(joints: Float[np.ndarray, "frames joints 3"]) -> Float[np.ndarray, "frames joints"]:
    parents = [max(parent, 0) for parent in HUMANML3D.parents]
    return np.linalg.norm(joints - joints[:, parents], axis=-1)
