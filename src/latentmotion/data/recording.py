"""Recordings between a file and a prepared folder: as joints, as SMPL poses, or as features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.data.captions import TaggedSentence
from latentmotion.data.clip import Split
from latentmotion.errors import InputError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.representation.smpl import smpl_features
from latentmotion.storage.limits import FARTHEST, MOST_NUMBER

SMPL_JOINTS = 24


def as_numbers(values: Any) -> np.ndarray:
    """Returns an array; raises ValueError where there are not numbers alone."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"found {array.dtype}")
    return array


@dataclass(frozen=True)
class Label:
    """Everything known about a recording besides its motion."""

    id: str
    """Unique name of the clip that is made from it."""
    source: str
    """Name of its source."""
    origin: str
    """The file it was cut from and where."""
    split: Split
    """Its split."""
    sentences: tuple[TaggedSentence, ...] = ()
    """Captions."""
    mirrored_sentences: tuple[TaggedSentence, ...] = ()
    """Captions of its mirror image."""
    action: str | None = None
    """Action label."""
    mirrored_action: str | None = None
    """Action label of its mirror image."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion as joints, cut, at the frame rate of the data set."""

    label: Label
    """Everything else about it."""
    joints: Float[np.ndarray, "frames joints 3"]
    """Joint positions, meters, y up; body proportions as recorded."""


@dataclass(frozen=True, eq=False)
class EncodedRecording:
    """A motion as features: of a recording, or from an official processed folder."""

    label: Label
    """Everything else about it."""
    features: Float[np.ndarray, "frames features"]
    """Features, not normalized."""
    round_trip_mm: float | None = None
    """Largest distance of a joint after joints → features → joints, where there were joints."""


@dataclass(frozen=True)
class Dropped:
    """Something that is left out of the data set."""

    id: str
    """The clip, or the file."""
    what: str
    """`clip`, `part` of one (the rest is kept) or `caption`."""
    reason: str
    """Why."""


@dataclass(frozen=True, eq=False)
class PosedRecording:
    """A motion from a data set of SMPL poses, in the axes of its camera."""

    label: Label
    """Everything else about it."""
    pose: Float[np.ndarray, "frames 72"]
    """Rotation vectors of the 24 joints, radians."""
    root: Float[np.ndarray, "frames 3"]
    """Positions of the root, meters, from any origin."""

    def encode(self, hold: int) -> EncodedRecording | Dropped:
        """Returns the features, or the reason why there are none.

        Args:
            hold: Length in frames to which shorter motions are padded with their last frame; 0
                pads none.

        Raises:
            InputError: `hold` is negative.
        """
        if hold < 0:
            raise InputError(f"--hold {hold}: expected a number of frames, or 0 for none")
        finite = (np.abs(self.pose) <= MOST_NUMBER).all() and (np.abs(self.root) <= FARTHEST).all()
        if not len(self.pose) or not finite:
            reason = "numbers that are not finite" if len(self.pose) else "no frame"
            return Dropped(self.label.id, "clip", reason)
        rotation_vectors = self.pose.astype(np.float64).reshape(-1, SMPL_JOINTS, 3)
        rotations = matrix_from_axis_angle(rotation_vectors)
        features = smpl_features(rotations, self.root - self.root[:1])
        padding = np.repeat(features[-1:], max(hold - len(features), 0), axis=0)
        return EncodedRecording(self.label, np.concatenate([features, padding]))
