"""Motions of other models: a folder of joint positions, a file per prompt and take.

FOLDER/side-01_0.npy   (frames, 22, 3) meters, y up, SMPL's body joints as HumanML3D orders them
FOLDER/side-01_1.npz   the same as `joints`, with `fps` if it wants
"""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.resampling import interpolate
from latentmotion.describe.facts import FPS
from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.evaluation.instructions.prompts import Instruction

Joints = Float[np.ndarray, "_ 22 3"]

LONGEST = 200_000
"""Frames of a file that are read."""

_LEGS = (0.4, 1.3)
"""Meters that a leg may have."""


def read_folder(
    folder: Path, instructions: Sequence[Instruction], takes: int, fps: float
) -> list[list[Joints]]:
    """Reads the motions of every prompt, at 20 frames per second.

    Args:
        folder: Where the files are.
        instructions: The prompts.
        takes: Motions of each.
        fps: Frames per second of files that do not say.

    Raises:
        DataError: A file is missing, or the bodies do not stand upright on the floor of meters.
        FileFormatError: A file is damaged, or no motion of 22 joints.
        InputError: `fps` is no rate.
    """
    if not (np.isfinite(fps) and 1 <= fps <= 1000):
        raise InputError(f"--fps {fps:g}: expected 1 to 1000 frames per second")
    paths = [[_path(folder, one.id, take) for take in range(takes)] for one in instructions]
    _check_complete(folder, [path for row in paths for path in row])
    motions = [[_read(path, fps) for path in row] for row in paths]
    _check_axes(folder, [motion for row in motions for motion in row])
    return [[_on_floor(motion) for motion in row] for row in motions]


def _path(folder: Path, prompt: str, take: int) -> Path:
    path = folder / f"{prompt}_{take}.npz"
    return path if path.is_file() else path.with_suffix(".npy")


def _check_complete(folder: Path, paths: list[Path]) -> None:
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder; expected one of joint positions")
    missing = [path for path in paths if not path.is_file()]
    if missing:
        raise DataError(
            f"{folder} lacks {len(missing)} of {len(paths)} files, the first {missing[0].name} "
            "(or .npz); write one per prompt and take, or lower --takes"
        )


def _read(path: Path, fps: float) -> Joints:
    try:
        with path.open("rb") as opened:
            loaded = np.load(opened, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                joints = loaded
            else:
                joints = loaded["joints"]
                fps = float(np.ravel(loaded["fps"])[0]) if "fps" in loaded.files else fps
    except (ValueError, KeyError, IndexError, OSError, EOFError, zipfile.BadZipFile) as error:
        expected = "expected an array `joints` of shape (frames, 22, 3)"
        raise FileFormatError(path, f"{expected} ({error})") from error
    return _at_20_fps(path, _checked(path, joints), fps)


def _checked(path: Path, joints: np.ndarray) -> Joints:
    if joints.ndim != 3 or joints.shape[1:] != (22, 3) or joints.dtype.kind != "f":
        raise FileFormatError(
            path,
            f"found {joints.dtype} of shape {joints.shape}, expected floats (frames, 22, 3)",
        )
    if not 8 <= len(joints) <= LONGEST:
        raise FileFormatError(path, f"found {len(joints)} frames, expected 8 to {LONGEST}")
    if not np.isfinite(joints).all():
        raise FileFormatError(path, "found NaN or infinite positions, expected numbers")
    return joints.astype(np.float64)


def _at_20_fps(path: Path, joints: Joints, fps: float) -> Joints:
    if not (np.isfinite(fps) and 1 <= fps <= 1000):
        raise FileFormatError(path, f"found fps {fps:g}, expected 1 to 1000")
    resampled = joints if fps == FPS else interpolate(joints, fps / FPS)
    if len(resampled) < 8:
        raise FileFormatError(path, f"lasts {len(joints) / fps:.2f} s, expected 0.4 s or more")
    return resampled


def _check_axes(folder: Path, motions: list[Joints]) -> None:
    """Most motions stand, so that a folder in other axes or units shows."""
    upward = np.median([(m[:, 15] - m[:, 0]).mean(axis=0) for m in motions], axis=0)
    if upward[1] < np.abs(upward[[0, 2]]).max():
        raise DataError(
            f"{folder}: heads are {upward.round(2).tolist()} from the hips; expected y up"
        )
    leg = float(np.median([_leg(motion) for motion in motions]))
    if not _LEGS[0] <= leg <= _LEGS[1]:
        raise DataError(f"{folder}: legs are {leg:.3g} long; expected positions in meters")


def _leg(joints: Joints) -> float:
    """Returns the length of thigh and shank, of both legs the mean."""
    hip, knee, ankle = joints[:, [1, 2]], joints[:, [4, 5]], joints[:, [7, 8]]
    bones = [np.linalg.norm(knee - hip, axis=-1), np.linalg.norm(ankle - knee, axis=-1)]
    return float(np.median(bones[0] + bones[1]))


def _on_floor(joints: Joints) -> Joints:
    """Puts the lowest foot on the floor, as HumanML3D does."""
    lowest = joints[:, [7, 8, 10, 11], 1].min()
    return joints - np.array([0.0, lowest, 0.0])
