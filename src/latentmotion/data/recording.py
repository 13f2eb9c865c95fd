"""Recordings between a file and a prepared folder; takes on disk, and their joints.

Frame rates change by taking every n-th frame where that is exact, and by interpolation elsewhere.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Split, TaggedSentence
from latentmotion.errors import DataError, InputError
from latentmotion.kinematics.humanoid import to_humanml3d
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import Animation, Joints, interpolate
from latentmotion.representation.smpl import smpl_features
from latentmotion.storage.limits import FARTHEST, MOST_NUMBER

Item = TypeVar("Item")

SMPL_JOINTS = 24


def as_numbers(values: Any) -> np.ndarray:
    """Returns an array; raises ValueError where there are not numbers alone."""
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"found {array.dtype}")
    return array


@dataclass(frozen=True)
class Label:
    """Everything known about a recording except its motion."""

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
    start: float = 0.0
    """Seconds of its file that come before it."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A motion as joints, cut, at the frame rate of the data set."""

    label: Label
    """Everything else about it."""
    joints: Joints
    """Joint positions, meters, y up; body proportions as recorded."""


@dataclass(frozen=True, eq=False)
class EncodedRecording:
    """A motion as features: of a recording, or from an official processed folder."""

    label: Label  # Everything else about it.
    features: Float[np.ndarray, "frames features"]  # Features, not normalized.
    # Largest distance of a joint after joints → features → joints, where there were joints.
    round_trip_mm: float | None = None


@dataclass(frozen=True)
class Dropped:
    """Something that is left out of the data set."""

    id: str  # The clip, or the file.
    what: str  # `clip`, `part` of one (the rest is kept) or `caption`.
    reason: str  # The reason, as the report prints it.


@dataclass(frozen=True)
class FileGroup:
    """Some files of a source, which are read without the others; groups in order are the source."""

    files: tuple[Path, ...]  # What is read, with files beside it.
    # Reads them; a worker's process can be sent it.
    read: Callable[[], Iterable[Recording | Dropped]] = field(repr=False)


def in_groups(items: Sequence[Item], size: int | None) -> list[Sequence[Item]]:
    """Returns items in groups of a size, or in one of all."""
    step = size or max(len(items), 1)
    return [items[start : start + step] for start in range(0, len(items), step)]


@dataclass(frozen=True, eq=False)
class PosedRecording:
    """A motion from a data set of SMPL poses, in the axes of its camera."""

    label: Label  # Everything else about it.
    pose: Float[np.ndarray, "frames 72"]  # Rotation vectors of the 24 joints, radians.
    root: Float[np.ndarray, "frames 3"]  # Positions of the root, meters, from any origin.

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


FPS = 20  # Frames per second of prepared data, as in HumanML3D.


def files_below(folder: Path, endings: Collection[str]) -> list[Path]:
    """Returns the files below a folder by their endings, sorted; links to folders are followed.

    Args:
        folder: Folder to search, at any depth.
        endings: Endings in lower case, as `.bvh`; those of files may be in either.
    """
    files, visited = [], set()
    for directory, subfolders, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(directory)
        if real in visited:  # A link that leads back.
            subfolders.clear()
            continue
        visited.add(real)
        files += [Path(directory, name) for name in names if Path(name).suffix.lower() in endings]
    return sorted(files)


def joints_at(animation: Animation, fps: float, native_fps: float) -> Joints:
    """Returns HumanML3D's joints of an animation at another frame rate; see `at_rate`.

    Args:
        animation: A skeleton of known names, meters, y up.
        fps: Frames per second wanted.
        native_fps: Frames per second of the animation (files often say it wrongly).
    """
    step = whole_step(fps, native_fps)
    if step is not None:
        return to_humanml3d(every(animation, step))
    return at_rate(to_humanml3d(animation), fps, native_fps)


def at_rate(joints: Joints, fps: float, native_fps: float) -> Float[np.ndarray, "times joints 3"]:
    """Returns joints at another frame rate.

    Args:
        joints: Positions.
        fps: Frames per second wanted.
        native_fps: Frames per second of the joints.

    Returns:
        Joints: frame i is taken at i/fps seconds, so that the first frame always stays.

    Raises:
        DataError: They have a lower frame rate than a third of the wanted one.
    """
    if native_fps * 3 < fps:
        raise DataError(
            f"{native_fps:g} frames per second are too few for {fps:g}; check the rate given"
        )
    step = whole_step(fps, native_fps)
    return interpolate(joints, native_fps / fps) if step is None else joints[::step]


def whole_step(fps: float, native_fps: float) -> int | None:
    """Returns n where every n-th frame makes the wanted rate, or None where none does."""
    step = round(native_fps / fps)
    exact = step >= 1 and math.isclose(native_fps / fps, step, rel_tol=0.005)
    return step if exact else None


def every(animation: Animation, step: int, start: int = 0) -> Animation:
    """Returns every `step`-th frame from `start` on."""
    return replace(animation.picked(slice(start, None, step)), fps=animation.fps / step)
