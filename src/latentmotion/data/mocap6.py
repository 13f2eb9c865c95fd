"""Labels of the exercises in six CMU trials, ten a second, by Fox and Hughes (BSD 2-clause).

A file `SS_TT.txt` holds a number for each tenth of a second, from 1, in the order of `EXERCISES`.
Where HumanML3D has captions of the same trials, they name the same exercises.
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from latentmotion.data.finding import files_below
from latentmotion.errors import FileFormatError

EXERCISES = (
    "does jumping jacks",
    "jogs in place",
    "does squats",
    "raises the knees to the elbows in turn",
    "circles both arms",
    "twists the upper body from side to side",
    "reaches up to the sides in turn",
    "boxes, punching the air",
    "squats down and gets up again",
    "bends down and touches the toes with one hand",
    "bends the upper body from side to side",
    "bends down and touches the toes with both hands",
)

_FOLDER, _RATE = "mocap6_labels", 10


def read_exercises(folder: Path, fps: int) -> dict[str, list[tuple[int, int, str]]]:
    """Returns the stretches of each trial: first frame, one past the last, the exercise.

    Args:
        folder: Where to look for a folder `mocap6_labels`, at any depth.
        fps: Frames per second to count in.

    Raises:
        FileFormatError: A file holds something else.
    """
    paths = [path for path in files_below(folder, [".txt"]) if path.parent.name == _FOLDER]
    return {path.stem: _stretches(path, fps // _RATE) for path in paths}


def _stretches(path: Path, frames: int) -> list[tuple[int, int, str]]:
    words = path.read_text(encoding="utf-8", errors="replace").split()
    known = {str(number): text for number, text in enumerate(EXERCISES, 1)}
    if strange := sorted(set(words) - set(known)):
        raise FileFormatError(path, f"found {strange[0][:40]!r}, expected numbers from 1 to 12")
    found, start = [], 0
    for label, group in groupby(words):
        end = start + frames * len(list(group))
        found.append((start, end, known[label]))
        start = end
    return found
