"""Files of keypoints, what trackers write: `.npz`, `.npy`, `.json`, `.csv` and folders of `.json`.

    npz   points (frames, keypoints, 2 or 3), confidence (frames, keypoints), fps, names, size,
          focal
    npy   points alone; a last column of scores is known, as MediaPipe's (frames, 33, 4)
    json  {"format": 1, "fps": 30, "names": […], "points": [[[x, y, z], …], …],
           "confidence": [[…], …], "size": [width, height], "focal": pixels}; null was not seen.
          Or what OpenPose, AlphaPose and MMPose write: a file, or a folder with one per frame,
          taken in the order of their names; of several people the first
    csv   time,nose_x,nose_y,nose_confidence,left_shoulder_x,…; an empty cell was not seen. Scores
          may be called confidence, visibility, score or likelihood, columns x0,y0,z0,v0; times may
          be uneven, or frames counted

`names` may be the name of a layout: humanml3d, coco_17, coco_18, coco_133, body_25, halpe_26,
halpe_136, h36m, mediapipe_33; it may be left out where the number of keypoints tells it. All but
points and fps may be left out.

Unit and up axis of points in 3D are stated, or guessed by the body, as those of motions are.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, InputError, ReadingWarning, hint, named
from latentmotion.formats.checks import numbers, read_lines, whole_rate
from latentmotion.kinematics import keypoints
from latentmotion.kinematics.standing import AXES, METERS_PER_UNIT, meters_per_unit, up_axis
from latentmotion.storage.array_files import names_in, read_array, read_arrays
from latentmotion.storage.limits import MOST_FRAMES
from latentmotion.storage.reading import blamed_on, csv_rows, read_json_file

ENDINGS = (".npz", ".npy", ".json", ".csv")  # Endings of files that are read.

_KEYS = ("points", "confidence", "fps", "names", "size", "focal")
_AXES = ("x", "y", "z")

# Names of columns that say how surely a keypoint was seen.
_SCORES = ("confidence", "visibility", "score", "likelihood", "conf", "vis", "v", "c")

# Names of columns of time, and seconds per unit.
_SECONDS = {
    **dict.fromkeys(("time", "timestamp", "seconds", "time_s", "t"), 1.0),
    **dict.fromkeys(("time_ms", "timestamp_ms", "milliseconds"), 1e-3),
}

# Names of columns that count frames; spreadsheets' first has none.
_COUNTERS = ("frame", "frame_number", "frame_id", "frame_index", "index", "")

# Ratios of limb lengths to an adult's between which points count as meters.
_LIMBS = (0.5, 2.0)


@dataclass(frozen=True)
class KeypointOptions:
    """What the user says about a recording, over what its file does."""

    fps: float | None = None  # Frames per second.
    names: str | None = None  # Name of the layout.
    size: tuple[float, float] | None = None  # Width and height of the picture, pixels.
    focal: float | None = None  # Focal length, pixels.
    # Axis that points up, of points in 3D: y, -y, z and so on; by default shown by the body.
    up: str | None = None
    unit: str | float | None = None  # Unit of length of points in 3D; by default shown by the body.


def read_keypoints(
    path: str | Path, stated: KeypointOptions = KeypointOptions()
) -> keypoints.Keypoints:
    """Reads the keypoints of one person.

    Args:
        path: The file, whose ending says its format, or a folder of JSON files.
        stated: Facts that override the file's.

    Raises:
        FileFormatError: The file is damaged, lacks something or contradicts itself.
        InputError: Its ending is unknown, or a layout that is stated.

    Warns:
        ReadingWarning: Unit or axes are a guess, or scores were clipped.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if not path.is_dir() and ending not in ENDINGS:
        raise InputError(
            f"the ending {ending or '(none)'!r} of {path} is none of keypoints: known are "
            f"{', '.join(ENDINGS)}, or a folder of .json"
        )
    if not path.exists():
        raise InputError(f"there is no file {path}")
    if stated.up is not None and stated.up not in AXES:
        raise InputError(f"up is {stated.up!r}: expected {', '.join(AXES)}")
    with blamed_on(path), blamed_on(path, ValueError, TypeError, problem="no keypoints: {error}"):
        if path.is_dir():
            # What trackers write for each frame.
            files = sorted(file for file in path.iterdir() if file.suffix.lower() == ".json")
            if not files:
                problem = "expected a folder of .json, one for each frame; found none"
                raise FileFormatError(path, problem)
            if len(files) > MOST_FRAMES:
                raise FileFormatError(path, f"more than {MOST_FRAMES:,} frames")
            frames = [list(_people(read_json_file(file))) for file in files]
            for file, people in zip(files, frames, strict=True):
                if len(people) != 1:
                    problem = f"found {len(people)} frames, expected one in each file"
                    raise FileFormatError(file, problem)
            values = _of_people([people for (people,) in frames])
        elif ending == ".npz":
            _check_keys(path, names_in(path))
            values = read_arrays(path, _KEYS)
        elif ending == ".npy":
            values = {"points": read_array(path)}
        else:
            values = _json(path) if ending == ".json" else _csv(path)
        return _keypoints(path, values, stated)


def _keypoints(
    path: Path, values: Mapping[str, Any], stated: KeypointOptions
) -> keypoints.Keypoints:
    if "points" not in values:
        raise InputError(f"lacks points; found {', '.join(sorted(values)) or 'nothing'}")
    points = np.asarray(values["points"], np.float64)
    if points.ndim != 3 or not points.size:
        raise InputError(f"points of shape {points.shape}: expected (frames, keypoints, 2 or 3)")
    confidence, scored = values.get("confidence"), points.shape[2] == 4
    if confidence is None and points.shape[2] == 3:
        # Two pixel coordinates and a score, as OpenPose has them: no room is 50 m wide, and no
        # score exceeds 2.
        pixels, last = np.nan_to_num(points[..., :2]), np.nan_to_num(points[..., 2])
        scored = np.abs(pixels).max() > 50 and last.min() >= 0 and last.max() <= 2
    if confidence is None and scored:
        points, confidence = points[..., :-1], points[..., -1]
    fps = stated.fps if stated.fps is not None else values.get("fps")
    if fps is None:
        raise InputError("does not say how many frames a second has; give it with --fps")
    # From a list, the name of a layout, or their number.
    about_names = stated.names or values.get("names")
    if about_names is None:
        names = keypoints.layout_of(points.shape[1], points.shape[2])
    elif (array := np.asarray(about_names)).ndim:
        names = tuple(str(name) for name in array.ravel())
    else:
        names = named("layout", str(array), keypoints.LAYOUTS)
    notes: list[str] = []
    if confidence is None:
        confidence = np.ones(points.shape[:2])
    confidence = np.nan_to_num(np.asarray(confidence, np.float64))
    if confidence.size and (most := float(confidence.max())) > 1:
        notes.append(f"scores go up to {most:.3g}: those above 1 count as 1")
        confidence = np.minimum(confidence, 1)
    if points.shape[1] == len(names) and points.shape[2] == 3:
        points, guesses = _upright(points, keypoints.canonical_names(names), stated)
        notes += guesses
    for line in notes:
        warnings.warn(f"{path}: {line}", ReadingWarning, stacklevel=3)
    size = stated.size
    if size is None and values.get("size") is not None:
        width, height = (float(side) for side in np.asarray(values["size"]).ravel())
        size = width, height
    focal = stated.focal if stated.focal is not None else values.get("focal")
    return keypoints.Keypoints(
        points,
        np.maximum(confidence, 0),
        float(np.asarray(fps).item()),
        names,
        size,
        None if focal is None else float(np.asarray(focal).item()),
    )


def _upright(
    points: Float[np.ndarray, "frames keypoints 3"], names: tuple[str, ...], stated: KeypointOptions
) -> tuple[Float[np.ndarray, "frames keypoints 3"], list[str]]:
    """Returns points in meters, y up, and what was guessed."""
    guesses, meters = [], 1.0
    ratio = keypoints.limb_ratio(points, names)
    if stated.unit is not None:
        meters = meters_per_unit(stated.unit)
    elif ratio is not None and not _LIMBS[0] < ratio < _LIMBS[1]:
        unit = min(METERS_PER_UNIT, key=lambda unit: abs(np.log(ratio * METERS_PER_UNIT[unit])))
        meters = METERS_PER_UNIT[unit]
        if _LIMBS[0] < ratio * meters < _LIMBS[1]:
            guesses.append(f"lengths are taken for {unit}, by the limbs (or --unit)")
    up = stated.up
    if up is None:
        lines = keypoints.upward(points, names)
        up, about_up = up_axis(lines[np.isfinite(lines).all(axis=1)])
        guesses += about_up
    notes = [f"a guess: {', '.join(guesses)}"] if guesses else []
    return meters * points @ AXES[up], notes


def _people(data: Any) -> Iterator[Sequence[Any]]:
    """Yields the people in each frame of what OpenPose, AlphaPose and MMPose write."""
    match data:
        case {"people": list(people)} | {"instances": list(people)}:
            yield people
        case {"instance_info": list(frames)} | {"predictions": list(frames)}:
            yield from (people for frame in frames for people in _people(frame))
        case [{"image_id": _}, *_]:  # AlphaPose: a row for each person
            by_image: dict[str, list[Any]] = {}
            for person in data:
                by_image.setdefault(str(person["image_id"]), []).append(person)
            yield from by_image.values()
        case [{"keypoints": _}, *_]:
            yield data
        case [{}, *_] | [[], *_]:
            yield from (people for frame in data for people in _people(frame))
        case []:
            yield []
        case {}:
            frames = [frame for frame in data.values() if isinstance(frame, dict)]
            yield from (people for frame in frames for people in _people(frame))


_POINTS = ("pose_keypoints_3d", "pose_keypoints_2d", "keypoints", "pose_keypoints")


def _of_people(frames: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """Returns the points and scores of the first person of each frame."""
    rows: list[np.ndarray | None] = []
    for people in frames:
        person = people[0] if people and isinstance(people[0], dict) else {}
        points = next((person[key] for key in _POINTS if person.get(key)), None)
        if points is None:
            rows.append(None)
            continue
        values = np.asarray(points, np.float64)
        if values.ndim == 1:  # x, y, score again and again; four numbers in 3D
            width = 4 if person.get("pose_keypoints_3d") == points else 3
            values = values.reshape(-1, width)
        elif values.shape[1] in (2, 3) and "keypoint_scores" in person:
            values = np.column_stack([values, np.asarray(person["keypoint_scores"], np.float64)])
        else:
            values = np.column_stack([values, np.ones(len(values))])
        rows.append(values)
    shape = next((row.shape for row in rows if row is not None), None)
    if shape is None:
        raise InputError("holds nobody: expected people with keypoints")
    # Frames without anybody count as not seen: their scores are zero.
    table = np.stack([np.zeros(shape) if row is None else row for row in rows])
    scores = table[..., -1]
    points = np.where(scores[..., None] > 0, table[..., :-1], np.nan)
    return {"points": points, "confidence": scores}


def _json(path: Path) -> dict[str, Any]:
    data = read_json_file(path)
    if not (isinstance(data, dict) and set(_KEYS) & set(data)) and (people := [*_people(data)]):
        return _of_people(people)
    if not isinstance(data, dict):
        raise FileFormatError(path, "expected an object with points and fps")
    if data.pop("format", 1) != 1:
        raise FileFormatError(path, "of another format than 1; update latentmotion")
    _check_keys(path, data)
    points = data.get("points")
    if not isinstance(points, list) or not all(isinstance(frame, list) for frame in points):
        raise FileFormatError(path, "points: expected a list of frames, each a list of keypoints")
    present = (point for frame in points for point in frame if point)
    width = next((len(point) for point in present if isinstance(point, list)), 0)
    blank = [np.nan] * width
    numeric = int, float, type(None)  # and no bool, which is an int, too
    for number, frame in enumerate(points):
        for point in frame:
            fits = isinstance(point, list) and len(point) == width
            if point is not None and not (fits and all(type(value) in numeric for value in point)):
                problem = f"frame {number}: found {point!r:.60}, expected {width} numbers or null"
                raise FileFormatError(path, problem)
    filled = [[point or blank for point in frame] for frame in points]
    return {**data, "points": np.array(filled, np.float64)}  # null is NaN


def _check_keys(path: Path, keys: Sequence[str] | Mapping[str, Any]) -> None:
    if "joints" in keys and "points" not in keys:
        raise FileFormatError(
            path,
            "holds a motion, not what a tracker saw: expected points (frames, keypoints, 2 or 3); "
            "in Python, fit_motion(pipeline, motion.joints, fps=motion.fps) fits a motion",
        )
    for key in keys:
        if key not in _KEYS:
            raise FileFormatError(path, f"unknown key {key!r}: {hint(key, _KEYS)}")


def _csv(path: Path) -> dict[str, Any]:
    rows = csv_rows(path, read_lines(path))
    header = [name.strip() for name in rows[0]]
    columns: dict[str, dict[str, int]] = {}  # keypoint → x, y, z, score → column
    clock, counter, extra = None, None, []
    for number, column in enumerate(header):
        # A keypoint and `x`, `y`, `z` or a score, of `nose_x`, `nose.x` or `x0`.
        plain = re.fullmatch(r"([xyzv])_?(\d+)", column.lower())
        words = [*re.split(r"[_.](?=[^_.]+$)", column), ""]
        name, part = (plain[2], plain[1]) if plain else (words[0], words[1].lower())
        part = "score" if part in _SCORES else part
        if column.lower() in _SECONDS and clock is None:
            clock = number
        elif column.lower() in _COUNTERS:
            counter = number
        elif part == "score" or (part in _AXES and name):
            columns.setdefault(name, {})[part] = number
        else:
            extra.append(column)
    first = next(iter(columns.values()), {})
    axes = _AXES if "z" in first else _AXES[:2]
    missing = [f"{n}_{axis}" for n, has in columns.items() for axis in axes if axis not in has]
    if clock is None and counter is None:
        missing.append("time")
    if missing or not columns:
        lacks = ", ".join(missing[:4]) or "time, NAME_x, NAME_y"
        raise FileFormatError(path, f"lacks the columns {lacks}", 1)
    if extra:
        raise FileFormatError(path, f"unknown column {min(extra)!r}; expected NAME_x and so on", 1)
    if len(rows) > MOST_FRAMES + 1:
        raise FileFormatError(path, f"more than {MOST_FRAMES:,} frames")
    filled = [(line, row) for line, row in enumerate(rows[1:], 2) if row]
    table = np.full((len(filled), len(header)), np.nan)  # NaN where a cell is empty
    for place, (line, row) in enumerate(filled):
        if len(row) != len(header):
            problem = f"found {len(row)} values, expected {len(header)}"
            raise FileFormatError(path, problem, line)
        words = [(column, word) for column, word in enumerate(row) if word.strip()]
        columns_of_row = [column for column, _ in words]
        table[place, columns_of_row] = numbers(path, line, [word for _, word in words], len(words))
    if len(table) < 2:
        raise FileFormatError(path, f"{len(table)} frames, expected 2 or more")
    fps = None
    if clock is not None:
        table, fps = _evenly(path, table, table[:, clock] * _SECONDS[header[clock].lower()])
    scores = [
        table[:, has["score"]] if "score" in has else np.ones(len(table))
        for has in columns.values()
    ]
    numbered = all(name.isdigit() for name in columns)
    return {
        "points": table[:, [[has[axis] for axis in axes] for has in columns.values()]],
        "confidence": np.nan_to_num(np.stack(scores, axis=1)),
        "fps": fps,
        **({} if numbered else {"names": list(columns)}),
    }


def _evenly(
    path: Path, table: Float[np.ndarray, "rows n"], times: Float[np.ndarray, " rows"]
) -> tuple[Float[np.ndarray, "frames n"], float]:
    """Returns a table at even times, and its rate; what was not seen stays so."""
    steps = np.diff(times)
    if not (steps > 0).all():
        raise FileFormatError(path, "the times of the frames do not rise")
    step = float(np.median(steps))
    if steps.max() > _LONGEST_GAP * step:
        raise FileFormatError(
            path,
            f"the times of the frames are not evenly apart: {steps.max():g} s after "
            f"{times[:-1][steps.argmax()]:g} s, {step:g} s as a rule; cut the recording there",
        )
    # Cameras jitter: steps within 5 % of their mean are one frame each.
    if np.abs(steps / steps.mean() - 1).max() < 0.05:
        return table, whole_rate(float(1 / steps.mean()))
    even = times[0] + np.arange(int((times[-1] - times[0]) / step + 1e-6) + 1) * step
    before = np.clip(np.searchsorted(times, even, side="right") - 1, 0, len(times) - 2)
    share = ((even - times[before]) / steps[before])[:, None]
    return table[before] * (1 - share) + table[before + 1] * share, whole_rate(1 / step)


# Usual steps between frames that a recording may leave out.
_LONGEST_GAP = 5.0
