"""Helpers of readers: lines of words, with errors that name them; checks of rates and sizes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.kinematics.skeleton import Animation
from latentmotion.storage import limits, reading


def checked_rate(path: str | Path, fps: float, line: int | None = None) -> float:
    """Returns a frame rate that a file states.

    Raises:
        FileFormatError: It is no number, or out of range.
    """
    if not limits.LEAST_FPS <= fps <= limits.MOST_FPS:
        problem = (
            f"{fps:g} frames per second, expected {limits.LEAST_FPS:g} to {limits.MOST_FPS:,.0f}"
        )
        raise FileFormatError(path, problem, line)
    return float(fps)


def check_filled(path: str | Path, frames: int, joints: int, stated: int) -> None:
    """Checks how much an animation will have, before it is made.

    Args:
        path: The file, for the error.
        frames: Number of frames, of all takes.
        joints: Number of joints.
        stated: Numbers that the file has.

    Raises:
        FileFormatError: It is far more than the file states.
    """
    most = max(limits.MOST_FILLED, limits.FILLED_FACTOR * stated)
    if frames * joints > most:
        problem = f"{frames:,} frames of {joints:,} joints, of which it states {stated:,} numbers"
        raise FileFormatError(
            path, f"{problem}; at most {most:,} frames times joints are filled in"
        )


def checked_animation(path: str | Path, animation: Animation) -> Animation:
    """Returns an animation whose numbers are finite and near enough to be counted in float32.

    Raises:
        FileFormatError: They are not.
    """
    far = (animation.skeleton.offsets, animation.root_positions, animation.translations)
    near = all(part is None or (np.abs(part) <= limits.FARTHEST).all() for part in far)
    if not (near and np.isfinite(animation.rotations).all()):
        problem = f"holds numbers that are not finite, or places beyond {limits.FARTHEST:,.0f} m"
        raise FileFormatError(path, f"{problem}; repair it, or check its unit of length")
    return animation


def read_lines(path: str | Path) -> list[str]:
    """Reads a text file of any line ending, in UTF-8 or, failing that, Latin-1.

    Raises:
        FileFormatError: The file cannot be read, is empty or is not text.
    """
    text = reading.read_text(path, "latin-1")  # names of bones, which older programs wrote so
    if not text.strip():
        raise FileFormatError(path, "the file is empty")
    # str.splitlines would also break at form feeds and the like, and the count would be off.
    return text.replace("\r\n", "\n").replace("\r", "\n").rstrip().split("\n")


def numbers(
    path: str | Path, line: int, words: Sequence[str], count: int
) -> Float[np.ndarray, " count"]:
    """Parses the words of one line as `count` finite numbers.

    Args:
        path: The file, for the error.
        line: The line, counted from 1, for the error.
        words: The words.
        count: Expected number of values.

    Raises:
        FileFormatError: There are more or fewer words, or one is not a finite number.
    """
    if len(words) != count:
        raise FileFormatError(path, f"found {len(words)} numbers, expected {count}", line)
    values = np.full(count, np.nan)
    for number, word in enumerate(words):
        with suppress(ValueError):
            values[number] = float(word)
        if not abs(values[number]) <= limits.MOST_NUMBER:
            problem = f"found {word[:40]!r}, expected a finite number up to {limits.MOST_NUMBER:g}"
            raise FileFormatError(path, problem, line)
    return values


def whole_rate(fps: float) -> float:
    """Undoes the rounding of times in a file: frames 0.0083333 s apart are 120 per second."""
    return float(round(fps)) if abs(fps - round(fps)) < 5e-4 * fps else fps


def table(
    path: str | Path, rows: Sequence[tuple[int, Sequence[str]]], width: int
) -> Float[np.ndarray, "rows width"]:
    """Parses the words of lines as rows of `width` finite numbers.

    Args:
        path: The file, for the error.
        rows: Number of each line, from 1, and its words.
        width: Numbers expected in each line.

    Raises:
        FileFormatError: A line has more or fewer words, or one that is not a finite number.
    """
    try:
        values = np.array([words for _, words in rows], np.float64).reshape(len(rows), width)
    except ValueError:
        values = np.full((1, width), np.nan)
    if (np.abs(values) <= limits.MOST_NUMBER).all():
        return values
    # Something is wrong: read line by line to find it.
    return np.stack([numbers(path, line, words, width) for line, words in rows])
