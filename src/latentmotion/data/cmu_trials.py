"""CMU's trials on disk: which file is whose, at which rate, with or without a T-pose before it."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.annotations import IndexRow, read_index
from latentmotion.data.clip import Source
from latentmotion.data.cmu_rates import native_fps
from latentmotion.data.finding import files_below
from latentmotion.data.resampling import every, joints_at
from latentmotion.data.t_pose import begins_with_t_pose, is_blended, without_blend
from latentmotion.errors import DataError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.formats.bvh import read_bvh

CMU = Source(
    name="cmu",
    license=(
        "free for all uses; the data itself may not be resold, even converted; "
        "captions: HumanML3D, MIT, (c) 2022 Chuan Guo; labels of exercises: BSD 2-clause, "
        "(c) 2015 Mike Hughes; trials at 30 frames per second: Apache 2.0, SNU"
    ),
    credit=(
        "The data used in this project was obtained from mocap.cs.cmu.edu. The database was "
        "created with funding from NSF EIA-0196217."
    ),
    url="http://mocap.cs.cmu.edu",
)

FPS = 20

_TRIAL = re.compile(r"(\d+_\d+)", re.ASCII)
_HUMANML3D_PATH = re.compile(r"/CMU/(?P<folder>[^/]+)/(?P<trial>\d+_\d+)_poses\.npy$")
_SAID = 120.0
"""Rate that conversions to BVH write into the file, whatever the trial's own."""


def find_trials(folder: Path) -> dict[str, Path]:
    """Returns the file of each CMU trial below a folder; AMC where there is BVH as well.

    Raises:
        DataError: There is no such folder, or no trial in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold CMU trials, from {CMU.url}")
    found = {}
    for ending in (".bvh", ".amc"):
        for path in files_below(folder, [ending]):
            if match := _TRIAL.match(path.stem):
                found[_without_zeros(match[1])] = path
    if not found:
        raise DataError(
            f"{folder}: expected CMU trials (SS_TT.amc with SS.asf, or SS_TT.bvh), found none; "
            f"get them from {CMU.url}"
        )
    return found


def rows_by_trial(humanml3d: Path) -> dict[str, list[IndexRow]]:
    """Returns HumanML3D's clips of each CMU trial.

    Raises:
        DataError: The index is missing or wrong.
    """
    rows = defaultdict(list)
    for row in read_index(humanml3d):
        if trial := trial_of(row.path):
            rows[trial].append(row)
    return dict(rows)


def trial_of(path: str) -> str | None:
    """Returns CMU's name of the trial behind a path in HumanML3D's index; None if not CMU's.

    Trials of two people are there twice under the first one's number, in folders such as
    `18_19_Justin` and `18_19_rory`; captions such as "is pulled" of "A pulls B" show that Rory is
    the second one, whom CMU numbers 19, 21 and 23.
    """
    match = _HUMANML3D_PATH.search(path)
    if match is None:
        return None
    subject, number = match["trial"].split("_")
    second = "rory" in match["folder"].lower()
    return f"{int(subject) + second:02d}_{number}"


def trial_joints(
    trial: str, path: Path, rate: float | None = None
) -> Float[np.ndarray, "frames joints 3"]:
    """Reads a trial at 20 frames per second, without a T-pose that a conversion put before it.

    Args:
        trial: Its name, such as `05_18`.
        path: Its file.
        rate: Native frames per second. By default what the file says if it is another rate than
            the 120 that all conversions claim, else the known one of the trial.

    Raises:
        FileFormatError: The file is damaged.
        DataError: The skeleton is unknown, or the rate too low.
    """
    if path.suffix.lower() == ".amc":
        return joints_at(read_asf_amc(path), FPS, rate or native_fps(trial))
    animation = read_bvh(path)
    native = rate or (native_fps(trial) if animation.fps == _SAID else animation.fps)
    if not begins_with_t_pose(animation):
        return joints_at(animation, FPS, native)
    joints = joints_at(every(animation, step=1, start=1), FPS, native)
    return without_blend(joints, native, FPS) if is_blended(animation) else joints


def _without_zeros(trial: str) -> str:
    """`005_08` and `5_8` are `05_08`."""
    subject, number = (int(part) for part in trial.split("_"))
    return f"{subject:02d}_{number:02d}"


def read_rates(path: Path) -> dict[str, float]:
    """Reads frames per second by trial from a JSON file.

    Raises:
        DataError: The file is missing or holds something else.
    """
    expected = 'expected frames per second by trial, such as {"05_18": 120}'
    try:
        rates = json.loads(path.read_text(encoding="utf-8"))
        return {trial: _rate(rate) for trial, rate in rates.items()}
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror}; {expected}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise DataError(f"{path}: {expected}, found something else ({error})") from error


def _rate(rate: float) -> float:
    if isinstance(rate, bool) or not 1 <= rate <= 1000:
        raise ValueError(f"a rate of {rate}")
    return float(rate)
