"""USD reader: the animations of a file, read by a process of its own with limits.

USD's library crashes on some damaged files and takes gigabytes for others. `usd_figure` runs as a
program with bounded memory and time, and hands its result over as arrays.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from latentmotion.errors import FileFormatError, LatentMotionError, MissingExtraError
from latentmotion.formats.takes import SkeletonTake
from latentmotion.kinematics.skeleton import Animation, Skeleton
from latentmotion.storage.array_files import read_arrays
from latentmotion.storage.limits import USD_SECONDS
from latentmotion.storage.reading import parse_json

_PROGRAM = "latentmotion.formats.usd_figure"
_REFUSED = 3
_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "PXR_WORK_THREAD_LIMIT"), "1"
)


def read_takes(path: str | Path) -> list[SkeletonTake]:
    """Reads all animations, with the captions of files that `usd.write` wrote.

    Raises:
        FileFormatError: The file is damaged, or has no skeleton.
    """
    arrays = _arrays(Path(path))
    takes = []
    for number, animation in enumerate(_animations(Path(path), arrays)):
        try:
            notes = parse_json(str(arrays[f"notes_{number}"]), path)
        except LatentMotionError:  # another program's
            notes = {}
        takes.append(SkeletonTake(animation, notes if isinstance(notes, dict) else {}))
    return takes


def read_animations(path: str | Path) -> list[Animation]:
    """Reads all animations that move the skeleton with the most joints; its rest if there is none.

    Raises:
        FileFormatError: The file is damaged, or has no skeleton.
    """
    return _animations(Path(path), _arrays(Path(path)))


def _animations(path: Path, arrays: Mapping[str, np.ndarray]) -> list[Animation]:
    names = tuple(map(str, arrays["names"]))
    skeleton = Skeleton(path.stem, names, tuple(arrays["parents"].tolist()), arrays["offsets"])
    return [
        Animation(
            skeleton,
            arrays[f"rotations_{number}"],
            arrays[f"root_{number}"],
            float(arrays[f"fps_{number}"]),
            arrays.get(f"translations_{number}"),
        )
        for number in range(int(arrays["takes"]))
    ]


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """Runs the program that reads the file."""
    if find_spec("pxr") is None:
        raise MissingExtraError("USD", "usd-core", "usd")
    places = {"PYTHONPATH": os.pathsep.join(sys.path)}
    environment: dict[str, Any] = os.environ | _ONE_THREAD | places
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "animations.npz"
        command = [sys.executable, "-m", _PROGRAM, str(path.absolute()), str(target)]
        try:
            done = subprocess.run(
                command, env=environment, capture_output=True, timeout=2 * USD_SECONDS, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise FileFormatError(path, f"not read in {2 * USD_SECONDS} s; damaged?") from error
        if done.returncode == _REFUSED:
            lines = done.stdout.decode(errors="replace").strip().splitlines()
            raise FileFormatError(path, lines[-1] if lines else "damaged, or not USD")
        if done.returncode:
            lines = done.stderr.decode(errors="replace").strip().splitlines()
            problem = f"USD's library ended with {done.returncode} ({(lines or [''])[-1]:.200})"
            raise FileFormatError(path, f"{problem}; the file is damaged, or too large")
        return read_arrays(target, lambda name: True)
