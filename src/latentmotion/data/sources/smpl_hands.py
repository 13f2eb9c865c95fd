"""Hands of AMASS's and Motion-X's files, as 30 joints more than the body's 22.

    .npz   poses (frames, 156) of SMPL-H: body, hands; (frames, 165) of SMPL-X: body, jaw and eyes,
           hands; z up
    .npy   Motion-X's (frames, 322): body, hands, jaw, expression and more; y up

Rotations are put on our own bones, fingers straight at rest; the mean hand of SMPL is not added.
Mahmood et al., "AMASS", ICCV 2019; Romero et al., "Embodied Hands", 2017; Lin et al., "Motion-X",
2023.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.formats.smpl import MOTIONX_NUMBERS
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY, HANDS, HUMANML3D, Skeleton
from latentmotion.motion import Motion
from latentmotion.storage.array_files import holds_objects, read_array, read_arrays
from latentmotion.storage.limits import MOST_NUMBER

BODY_JOINTS, HAND_JOINTS = len(HUMANML3D), len(HANDS) - len(HUMANML3D)

_BODY = 3 * BODY_JOINTS

# Where hands and face are among the numbers of a frame.
_PLACES = {
    156: (slice(_BODY, 156), slice(0)),
    165: (slice(75, 165), slice(_BODY, 75)),
    MOTIONX_NUMBERS: (slice(_BODY, 156), slice(156, 209)),  # jaw and expression
}

# Radians up to which hands count as resting.
_MOVED = 1e-3


class WholeBody(NamedTuple):
    """Poses of body, hands and face, as rotation vectors in the axes of their file."""

    body: Float[np.ndarray, "frames 22 3"]
    """Of HumanML3D's joints."""
    hands: Float[np.ndarray, "frames 30 3"] | None
    """None if they rest."""
    face_moves: bool
    """Whether jaw, eyes or expression move, which are never kept."""
    z_up: bool
    """Whether z is up, else y."""

    def joints(self, motion: Motion) -> Float[np.ndarray, "frames 52 3"]:
        """Returns positions of body and fingers, meters, y up.

        Args:
            motion: The body, as it was read from the same file.
        """
        hands = self.hands if self.hands is not None else np.zeros((len(motion), HAND_JOINTS, 3))
        rotations = matrix_from_axis_angle(np.concatenate([self.body, hands], axis=1))
        turned = _REST.forward_kinematics(rotations, np.zeros((len(motion), 3)))
        if self.z_up:
            turned = turned @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        fingers = turned[:, BODY_JOINTS:] - turned[:, :1] + motion.joints[:, :1]
        return np.concatenate([motion.joints, fingers], axis=1)


def whole_body(path: Path) -> WholeBody | None:
    """Returns the poses of a file; None if it has no places for hands.

    Raises:
        FileFormatError: The file is damaged, or holds NaN.
    """
    ending, poses = path.suffix.lower(), None
    if ending == ".npz":
        poses = read_arrays(path, lambda name, *_: name == "poses").get("poses")
    elif ending == ".npy" and not holds_objects(path):
        poses = read_array(path)
    # Only SMPL-H and SMPL-X are in an .npz, only Motion-X is in an .npy.
    if poses is None or poses.ndim != 2 or poses.shape[1] not in _PLACES:
        return None
    if (poses.shape[1] == MOTIONX_NUMBERS) != (ending == ".npy"):
        return None
    numbers = poses.dtype.kind in "fiu"
    if not numbers or not (np.abs(poses := poses.astype(np.float64)) < MOST_NUMBER).all():
        raise FileFormatError(path, "holds poses that are not finite numbers")
    at_hands, at_face = _PLACES[poses.shape[1]]
    body, hands = poses[:, :_BODY], poses[:, at_hands]
    rests = np.abs(hands).max(initial=0.0) <= _MOVED
    return WholeBody(
        body.reshape(-1, BODY_JOINTS, 3),
        None if rests else hands.reshape(-1, HAND_JOINTS, 3),
        bool(np.abs(poses[:, at_face]).max(initial=0.0) > _MOVED),
        z_up=ending == ".npz",
    )


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
