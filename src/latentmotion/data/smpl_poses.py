"""SMPL's poses as data sets hold them, axis-angle per joint → the features of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.data.recording import Dropped, EncodedRecording, Label
from latentmotion.errors import InputError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.representation.smpl import smpl_features

JOINTS = 24


@dataclass(frozen=True, eq=False)
class PosedRecording:
    """A motion as a data set of SMPL's poses holds it, in the axes of its camera."""

    label: Label
    """What is known about it."""
    pose: Float[np.ndarray, "frames 72"]
    """Rotation vectors of the 24 joints, radians."""
    way: Float[np.ndarray, "frames 3"]
    """Where the root is, meters, from any start."""

    def encode(self, hold: int) -> EncodedRecording | Dropped:
        """Returns the features, or why there are none.

        Args:
            hold: Frames up to which a shorter motion keeps still in its last one; 0 for none.

        Raises:
            InputError: `hold` is negative.
        """
        if hold < 0:
            raise InputError(f"--hold {hold}: expected a number of frames, or 0 for none")
        finite = np.isfinite(self.pose).all() and np.isfinite(self.way).all()
        if not len(self.pose) or not finite:
            reason = "numbers that are not finite" if len(self.pose) else "no frame"
            return Dropped(self.label.id, "clip", reason)
        turns = matrix_from_axis_angle(self.pose.astype(np.float64).reshape(-1, JOINTS, 3))
        features = smpl_features(turns, self.way - self.way[:1])
        still = np.repeat(features[-1:], max(hold - len(features), 0), axis=0)
        return EncodedRecording(self.label, np.concatenate([features, still]))
