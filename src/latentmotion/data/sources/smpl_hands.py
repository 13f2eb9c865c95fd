"""Hands of AMASS's SMPL-H and SMPL-X files, as 30 joints more than the body's 22.

    poses   (frames, 156) of SMPL-H: body, hands; (frames, 165) of SMPL-X: body, jaw and eyes, hands

Rotations are put on our own bones, fingers straight at rest; the mean hand of SMPL is not added.
Mahmood et al., "AMASS", ICCV 2019; Romero et al., "Embodied Hands", 2017.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.formats import smpl_npz
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY, HANDS, HUMANML3D, Skeleton
from latentmotion.storage.array_files import read_arrays
from latentmotion.storage.limits import MOST_NUMBER

BODY_JOINTS, HAND_JOINTS = len(HUMANML3D), len(HANDS) - len(HUMANML3D)

# First number of the hands by the numbers of a frame.
_HANDS_AT = {156: 66, 165: 75}

# Radians up to which hands count as resting.
_MOVED = 1e-3


def hand_poses(path: Path) -> Float[np.ndarray, "frames 30 3"] | None:
    """Returns the rotation vectors of both hands; None if a file has none, or they rest.

    Raises:
        FileFormatError: The file is damaged, or holds NaN.
    """
    poses = _poses(path)
    if poses is None:
        return None
    start = _HANDS_AT[poses.shape[1]]
    hands = poses[:, start : start + 3 * HAND_JOINTS].astype(np.float64)
    return hands.reshape(-1, HAND_JOINTS, 3) if np.abs(hands).max(initial=0.0) > _MOVED else None


def face_moves(path: Path) -> bool:
    """Returns whether a file has poses of jaw and eyes, which are never kept.

    Raises:
        FileFormatError: The file is damaged, or holds NaN.
    """
    poses = _poses(path)
    if poses is None:
        return False
    face = poses[:, 3 * BODY_JOINTS : _HANDS_AT[poses.shape[1]]]
    return bool(np.abs(face).max(initial=0.0) > _MOVED)


def _poses(path: Path) -> Float[np.ndarray, "frames numbers"] | None:
    if path.suffix.lower() != ".npz":
        return None
    poses = read_arrays(path, lambda name, *_: name == "poses").get("poses")
    if poses is None or poses.ndim != 2 or poses.shape[1] not in _HANDS_AT:
        return None
    if poses.dtype.kind not in "fiu" or not (np.abs(poses) < MOST_NUMBER).all():
        raise FileFormatError(path, "holds poses that are not finite numbers")
    return poses


def joints_with_hands(
    path: Path, hands: Float[np.ndarray, "frames 30 3"]
) -> tuple[Float[np.ndarray, "frames 52 3"], float]:
    """Returns positions of body and fingers, meters, y up, and the frame rate.

    Raises:
        FileFormatError: As for `latentmotion.load`.
    """
    keys = smpl_npz.KEYS
    motion = smpl_npz.read_arrays(path, read_arrays(path, lambda name, *_: name in keys))
    poses = read_arrays(path, lambda name, *_: name == "poses")["poses"].astype(np.float64)
    body = poses[:, : 3 * BODY_JOINTS].reshape(-1, BODY_JOINTS, 3)
    rotations = matrix_from_axis_angle(np.concatenate([body, hands], axis=1))
    turned = _REST.forward_kinematics(rotations, np.zeros((len(poses), 3)))
    upright = turned @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # AMASS's z to our y
    fingers = upright[:, BODY_JOINTS:] - upright[:, :1] + motion.joints[:, :1]
    return np.concatenate([motion.joints, fingers], axis=1), motion.fps


def _rest() -> Skeleton:
    """Returns our T-pose with fingers that continue the arms."""
    offsets = np.concatenate([BODY.offsets[:BODY_JOINTS], np.zeros((HAND_JOINTS, 3))])
    lengths = np.linalg.norm(HANDS.offsets[BODY_JOINTS:], axis=1)
    ahead = HANDS.offsets[BODY_JOINTS:, 2] > 0
    side = np.repeat([1.0, -1.0], HAND_JOINTS // 2)
    offsets[BODY_JOINTS:, 0] = np.where(ahead, 0.0, side * lengths)
    offsets[BODY_JOINTS:, 2] = np.where(ahead, lengths, 0.0)
    return Skeleton("hands at rest", HANDS.names, HANDS.parents, offsets)


_REST = _rest()
