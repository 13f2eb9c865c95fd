"""CSV: one row per frame, for spreadsheets, statistics and other languages.

    time,pelvis_x,pelvis_y,pelvis_z,left_hip_x,…
    0.000000,0.012300,0.921000,-0.004100,0.071200,…

Seconds and meters, y up, rounded to a micrometer; one take per file.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from latentmotion.errors import FileFormatError
from latentmotion.formats.checks import checked_rate, numbers, read_lines, whole_rate
from latentmotion.formats.takes import OURS, numbered
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.motion import Motion
from latentmotion.storage.files import atomic_file
from latentmotion.storage.reading import blamed_on

_TIME = "time"
_SINGLE_FPS = 20.0
"""Frames per second of a file with a single row."""


def write(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes a file for each motion.

    Raises:
        InputError: The folder cannot be written.
    """
    paths = numbered(Path(path), len(motions))
    for target, motion in zip(paths, motions, strict=True):
        times = np.arange(len(motion)) / motion.fps
        rows = np.column_stack([times, motion.joints.reshape(len(motion), -1)])
        lines = [",".join([_TIME, *_columns(motion.skeleton.names)])]
        # Adding zero makes 0 of the -0 that rounding leaves.
        rows = np.round(rows.astype(np.float64), 6) + 0.0
        lines += [",".join([f"{value:.6f}" for value in row]) for row in rows.tolist()]
        with atomic_file(target) as temporary:
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return paths


def read(path: str | Path) -> list[Motion]:
    """Reads joints of one of our skeletons; columns may come in any order, others are ignored.

    Raises:
        FileFormatError: A number is missing or not finite, times are uneven, or joints unknown.
    """
    lines = read_lines(path)
    try:
        rows = list(csv.reader(lines))
    except csv.Error as error:
        raise FileFormatError(path, f"not CSV ({error})") from error
    header = [name.strip() for name in rows[0]]
    skeleton = _skeleton(path, header)
    columns = [header.index(name) for name in (_TIME, *_columns(skeleton.names))]
    values = []
    for line, row in enumerate(rows[1:], 2):
        if row and len(row) != len(header):
            problem = f"found {len(row)} values, expected {len(header)} as in the header"
            raise FileFormatError(path, problem, line)
        if row:
            words = [row[column].strip() for column in columns]
            values.append(numbers(path, line, words, len(columns)))
    if not values:
        raise FileFormatError(path, "has a header and no frame; it is truncated", 1)
    table = np.stack(values)
    joints = table[:, 1:].reshape(len(table), len(skeleton), 3).astype("f4")
    times = table[:, 0]
    if len(times) == 1:
        with blamed_on(path):
            return [Motion(joints, _SINGLE_FPS, skeleton)]
    length = float(times[-1] - times[0])
    fps = checked_rate(path, (len(times) - 1) / length) if length > 1e-9 else 0.0
    # Steps within 1 % of their mean differ by the rounding of times only.
    if np.abs(np.diff(times) * fps - 1).max() > 0.01:
        raise FileFormatError(path, "the times of the frames are not evenly apart; resample them")
    with blamed_on(path):
        return [Motion(joints, whole_rate(fps), skeleton)]


def _columns(names: Sequence[str]) -> list[str]:
    return [f"{name}_{axis}" for name in names for axis in "xyz"]


def _skeleton(path: str | Path, header: Sequence[str]) -> Skeleton:
    """Returns the largest of our skeletons whose columns are all there."""
    skeletons = sorted(OURS.values(), key=len, reverse=True)
    for skeleton in skeletons:
        if {_TIME, *_columns(skeleton.names)} <= set(header):
            return skeleton
    missing = [name for name in (_TIME, *_columns(skeletons[-1].names)) if name not in header]
    shown = ", ".join(missing[:4]) + (" …" if len(missing) > 4 else "")
    raise FileFormatError(
        path,
        f"lacks the columns {shown}; expected time and x, y, z of every joint of "
        f"{', '.join(skeleton.name for skeleton in skeletons)}",
        1,
    )
