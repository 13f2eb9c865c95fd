"""Files of keypoints, what trackers write: `.npz`, `.npy`, `.json` and `.csv`.

    npz   points (frames, keypoints, 2 or 3), confidence (frames, keypoints), fps, names, size,
          focal
    npy   points alone
    json  {"format": 1, "fps": 30, "names": […], "points": [[[x, y, z], …], …],
           "confidence": [[…], …], "size": [width, height], "focal": pixels}; null was not seen
    csv   time,nose_x,nose_y,nose_confidence,left_shoulder_x,…; an empty cell was not seen

`names` may be the name of a layout: humanml3d, coco_17, body_25, mediapipe_33; it may be left out
where the number of keypoints tells it. All but points and fps may be left out.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, InputError, hint
from latentmotion.formats.checks import read_lines, whole_rate
from latentmotion.kinematics.keypoints import LAYOUTS, Keypoints, layout_of
from latentmotion.storage.array_files import names_in, read_array, read_arrays
from latentmotion.storage.limits import MOST_FRAMES, MOST_NUMBER
from latentmotion.storage.reading import blamed_on, read_json_file

ENDINGS = (".npz", ".npy", ".json", ".csv")
"""Endings of files that are read."""

_KEYS = ("points", "confidence", "fps", "names", "size", "focal")
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Stated:
    """What the user says about a recording, over what its file does."""

    fps: float | None = None
    """Frames per second."""
    names: str | None = None
    """Name of the layout."""
    size: tuple[float, float] | None = None
    """Width and height of the picture, pixels."""
    focal: float | None = None
    """Focal length, pixels."""
    up: str = "y"
    """Axis that points up: y, -y or z."""


def read_keypoints(path: str | Path, stated: Stated = Stated()) -> Keypoints:
    """Reads the keypoints of one person.

    Args:
        path: The file; its ending says its format.
        stated: What is known besides.

    Raises:
        FileFormatError: The file is damaged, lacks something or contradicts itself.
        InputError: Its ending is unknown, or a layout that is stated.
    """
    path = Path(path)
    readers = dict(
        zip(ENDINGS, (_npz, lambda path: {"points": read_array(path)}, _json, _csv), strict=True)
    )
    ending = path.suffix.lower()
    if ending not in readers:
        raise InputError(
            f"the ending {ending or '(none)'!r} of {path} is none of keypoints: known are "
            f"{', '.join(ENDINGS)}"
        )
    if not path.is_file():
        raise InputError(f"there is no file {path}")
    if stated.up not in ("y", "-y", "z"):
        raise InputError(f"up is {stated.up!r}: expected y, -y or z")
    with blamed_on(path):
        try:
            return _keypoints(readers[ending](path), stated)
        except (ValueError, TypeError) as error:
            raise FileFormatError(path, f"no keypoints: {error}") from error


def _keypoints(found: Mapping[str, Any], stated: Stated) -> Keypoints:
    if "points" not in found:
        raise InputError(f"lacks points; found {', '.join(sorted(found)) or 'nothing'}")
    points = np.asarray(found["points"], np.float64)
    if points.ndim != 3 or not points.size:
        raise InputError(f"points of shape {points.shape}: expected (frames, keypoints, 2 or 3)")
    fps = stated.fps if stated.fps is not None else found.get("fps")
    if fps is None:
        raise InputError("does not say how many frames a second has; give it with --fps")
    if points.shape[2] == 3 and stated.up != "y":
        x, y, z = np.moveaxis(points, 2, 0)
        points = np.stack([x, -y, -z] if stated.up == "-y" else [x, z, -y], axis=2)
    confidence = found.get("confidence")
    size = stated.size
    if size is None and found.get("size") is not None:
        width, height = (float(side) for side in np.asarray(found["size"]).ravel())
        size = width, height
    focal = stated.focal if stated.focal is not None else found.get("focal")
    names = _names(stated.names or found.get("names"), points.shape[1])
    return Keypoints(
        points,
        np.ones(points.shape[:2]) if confidence is None else np.asarray(confidence, np.float64),
        float(np.asarray(fps).item()),
        names,
        size,
        None if focal is None else float(np.asarray(focal).item()),
    )


def _names(found: Any, count: int) -> tuple[str, ...]:
    """Returns the names of the keypoints, from a list, the name of a layout, or their number."""
    if found is None:
        return layout_of(count)
    values = np.asarray(found)
    if values.ndim == 0:
        layout = str(values)
        if layout not in LAYOUTS:
            raise InputError(f"unknown layout {layout!r}: {hint(layout, LAYOUTS)}")
        return LAYOUTS[layout]
    return tuple(str(name) for name in values.ravel())


def _npz(path: Path) -> dict[str, Any]:
    _check_keys(path, names_in(path))
    return dict(read_arrays(path, _KEYS))


def _json(path: Path) -> dict[str, Any]:
    found = read_json_file(path)
    if not isinstance(found, dict):
        raise FileFormatError(path, "expected an object with points and fps")
    if found.pop("format", 1) != 1:
        raise FileFormatError(path, "of another format than 1; update latentmotion")
    _check_keys(path, found)
    points = found.get("points")
    if not isinstance(points, list) or not all(isinstance(frame, list) for frame in points):
        raise FileFormatError(path, "points: expected a list of frames, each a list of keypoints")
    given = (point for frame in points for point in frame if point)
    width = next((len(point) for point in given if isinstance(point, list)), 0)
    blank = [np.nan] * width
    for number, frame in enumerate(points):
        for point in frame:
            if point is not None and not (isinstance(point, list) and len(point) == width):
                problem = f"frame {number}: found {point!r:.60}, expected {width} numbers or null"
                raise FileFormatError(path, problem)
    filled = [[[_number(v) for v in point or blank] for point in frame] for frame in points]
    return {**found, "points": filled}


def _number(value: Any) -> float:
    if value is None:
        return np.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"found {value!r:.60}, expected a number or null")
    return float(value)


def _check_keys(path: Path, keys: Sequence[str] | Mapping[str, Any]) -> None:
    if "joints" in keys and "points" not in keys:
        raise FileFormatError(
            path,
            "holds a motion, not what a tracker saw: expected points (frames, keypoints, 2 or 3); "
            "in Python, generate.fit(motion.joints, fps=motion.fps) fits a motion",
        )
    for key in keys:
        if key not in _KEYS:
            raise FileFormatError(path, f"unknown key {key!r}: {hint(key, _KEYS)}")


def _csv(path: Path) -> dict[str, Any]:
    try:
        rows = list(csv.reader(read_lines(path)))
    except csv.Error as error:
        raise FileFormatError(path, f"not CSV ({error})") from error
    header = [name.strip() for name in rows[0]]
    named = [(name.rpartition("_")[0], column) for column, name in enumerate(header)]
    names = list(dict.fromkeys(n for n, c in named if header[c].endswith(tuple("xyz")) and n))
    axes = _AXES if names and f"{names[0]}_z" in header else _AXES[:2]
    wanted = ["time", *(f"{name}_{axis}" for name in names for axis in axes)]
    missing = [name for name in wanted if name not in header]
    if missing or not names:
        lacks = ", ".join(missing[:4]) or "time, NAME_x, NAME_y"
        raise FileFormatError(path, f"lacks the columns {lacks}", 1)
    extra = set(header) - set(wanted) - {f"{name}_confidence" for name in names}
    if extra:
        raise FileFormatError(path, f"unknown column {min(extra)!r}; expected NAME_x and so on", 1)
    if len(rows) > MOST_FRAMES + 1:
        raise FileFormatError(path, f"more than {MOST_FRAMES:,} frames")
    table = np.array(
        [_cells(path, n, row, len(header)) for n, row in enumerate(rows[1:], 2) if row]
    )
    if len(table) < 2:
        raise FileFormatError(path, f"{len(table)} frames, expected 2 or more")
    times = table[:, header.index("time")]
    length = float(times[-1] - times[0])
    fps = (len(times) - 1) / length if length > 1e-9 else 0.0
    if not np.abs(np.diff(times) * fps - 1).max() < 0.05:
        raise FileFormatError(path, "the times of the frames are not evenly apart; resample them")
    columns = [[header.index(f"{name}_{axis}") for axis in axes] for name in names]
    confidence = [
        table[:, header.index(f"{name}_confidence")]
        if f"{name}_confidence" in header
        else np.ones(len(table))
        for name in names
    ]
    return {
        "points": table[:, columns],
        "confidence": np.nan_to_num(np.stack(confidence, axis=1)),
        "fps": whole_rate(fps),
        "names": names,
    }


def _cells(path: Path, line: int, row: Sequence[str], count: int) -> Float[np.ndarray, " count"]:
    """Returns the numbers of a row; NaN where a cell is empty."""
    if len(row) != count:
        raise FileFormatError(path, f"found {len(row)} values, expected {count}", line)
    values = []
    for word in row:
        try:
            value = float(word) if word.strip() else np.nan
        except ValueError as error:
            raise FileFormatError(path, f"found {word[:40]!r}, expected a number", line) from error
        if word.strip() and not abs(value) <= MOST_NUMBER:
            raise FileFormatError(path, f"found {word[:40]!r}, expected a finite number", line)
        values.append(value)
    return np.array(values)
