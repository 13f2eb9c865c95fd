"""Tables for spreadsheets, statistics and other languages: joints and contact events.

Joints, `.csv`: one row per frame.

    time,pelvis_x,pelvis_y,pelvis_z,left_hip_x,…
    0.000000,0.012300,0.921000,-0.004100,0.071200,…

Seconds and meters, y up, rounded to a micrometer; one take per file.

Contact events, when feet come down and leave the floor: `.contacts.csv` and `.contacts.json`.

    csv   time,event          0.35,left_foot_down      a row for each event, seconds
    json  {"fps": 20, "seconds": 4.0, "events": [{"time": 0.35, "event": "left_foot_down"}, …]}
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.cleanup.loops import is_loop, unrolled
from latentmotion.errors import FileFormatError
from latentmotion.formats import checks, numbered
from latentmotion.formats.takes import OURS
from latentmotion.measure.signals import spans
from latentmotion.motion import Motion
from latentmotion.storage import files, reading

_TIME = "time"
# Frames per second of a file with a single row.
_SINGLE_FPS = 20.0


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
        files.write_file(target, "\n".join(lines) + "\n")
    return paths


def read(path: str | Path) -> list[Motion]:
    """Reads joints of one of our skeletons; columns may come in any order, others are ignored.

    Raises:
        FileFormatError: A number is missing or not finite, times are uneven, or joints unknown.
    """
    rows = reading.csv_rows(path, checks.read_lines(path))
    header = [name.strip() for name in rows[0]]
    # The largest first, since the columns of a body with hands hold those of one without.
    skeletons = sorted(OURS.values(), key=len, reverse=True)
    fitting = (ours for ours in skeletons if {_TIME, *_columns(ours.names)} <= set(header))
    skeleton = next(fitting, None)
    if skeleton is None:
        missing = [name for name in (_TIME, *_columns(skeletons[-1].names)) if name not in header]
        shown = ", ".join(missing[:4]) + (" …" if len(missing) > 4 else "")
        raise FileFormatError(
            path,
            f"lacks the columns {shown}; expected time and x, y, z of every joint of "
            f"{', '.join(ours.name for ours in skeletons)}",
            1,
        )
    columns = [header.index(name) for name in (_TIME, *_columns(skeleton.names))]
    filled = [(line, row) for line, row in enumerate(rows[1:], 2) if row]
    for line, row in filled:
        if len(row) != len(header):
            problem = f"found {len(row)} values, expected {len(header)} as in the header"
            raise FileFormatError(path, problem, line)
    if not filled:
        raise FileFormatError(path, "has a header and no frame; it is truncated", 1)
    words = [(line, [row[column].strip() for column in columns]) for line, row in filled]
    table = checks.table(path, words, len(columns))
    joints = table[:, 1:].reshape(len(table), len(skeleton), 3).astype("f4")
    times = table[:, 0]
    if len(times) == 1:
        with reading.blamed_on(path):
            return [Motion(joints, _SINGLE_FPS, skeleton)]
    length = float(times[-1] - times[0])
    fps = checks.checked_rate(path, (len(times) - 1) / length) if length > 1e-9 else 0.0
    # Steps within 1 % of their mean differ by the rounding of times only.
    if np.abs(np.diff(times) * fps - 1).max() > 0.01:
        raise FileFormatError(path, "the times of the frames are not evenly apart; resample them")
    with reading.blamed_on(path):
        return [Motion(joints, checks.whole_rate(fps), skeleton)]


def _columns(names: Sequence[str]) -> list[str]:
    return [f"{name}_{axis}" for name in names for axis in "xyz"]


def contact_events(motion: Motion) -> list[dict[str, Any]]:
    """Returns when feet come down and leave the floor: `time` in seconds, and `event`.

    Args:
        motion: A motion; a loop's feet go on beyond its ends.
    """
    if not (motion.skeleton.left_foot or motion.skeleton.right_foot):
        return []
    count = len(motion) - 1 if is_loop(motion) else len(motion)
    whole = unrolled(motion, 1, 1) if is_loop(motion) else motion
    first = count if is_loop(motion) else 0
    standing = foot_contacts(whole.joints.astype(np.float64), whole.fps, whole.skeleton)
    half = len(whole.skeleton.left_foot)
    events: list[dict[str, Any]] = []
    for side, feet in (("left", standing[:, :half]), ("right", standing[:, half:])):
        for start, end in spans(np.asarray(feet.any(axis=1))):
            for frame, kind in ((start, "down"), (end, "up")):
                if first <= frame < first + count and frame > 0:
                    time = round((frame - first) / motion.fps, 4)
                    events.append({"time": time, "event": f"{side}_foot_{kind}"})
    return sorted(events, key=lambda event: event["time"])


def write_events(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes the events of each motion: `a.contacts.csv`, or `a-1.contacts.csv` and so on.

    Raises:
        InputError: The folder cannot be written.
    """
    paths = numbered(Path(path), len(motions))
    for target, motion in zip(paths, motions, strict=True):
        events = contact_events(motion)
        if target.suffix.lower() == ".csv":
            rows = [f"{event['time']:g},{event['event']}" for event in events]
            text = "\n".join(["time,event", *rows])
        else:
            whole = {"fps": motion.fps, "seconds": motion.seconds, "events": events}
            text = json.dumps(whole, indent=1)
        files.write_file(target, text + "\n")
    return paths
