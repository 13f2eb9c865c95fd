"""Errors that users can cause: what was found, what was expected and what to do next."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TypeVar

Entry = TypeVar("Entry")


def hint(name: str, known: Iterable[str]) -> str:
    """Returns the hint for an unknown name: the nearest known one, or all of them."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1)
    return f"did you mean {near[0]!r}?" if near else f"known are {', '.join(names)}"


def unreadable(error: OSError | ValueError) -> str:
    """Returns why a file cannot be read, and what to do; a ValueError is of its name."""
    match error:
        case IsADirectoryError():
            advice = "expected a file, name one in it"
        case PermissionError():
            advice = "expected a file that you may read, change its permissions or copy it"
        case FileNotFoundError() | NotADirectoryError() | ValueError():
            advice = "expected a file that is there, check its path"
        case _:
            advice = "expected a file that can be read, copy it again"
    return f"{getattr(error, 'strerror', None) or error}; {advice}"


class LatentMotionError(Exception):
    """Base of every error that is the input's fault; the command line prints it, exit code 2."""


class InputError(LatentMotionError):
    """An argument, option or prompt that cannot be used."""


class DiskFullError(InputError):
    """A file that was not written, as the disk has no room for it."""


class DataError(LatentMotionError):
    """A folder or data set that lacks something or contradicts itself."""


class ModelError(LatentMotionError):
    """A model folder or checkpoint that cannot be loaded."""


class FileFormatError(LatentMotionError):
    """A file that is damaged or of another kind.

    Args:
        path: The file.
        problem: What was found, what was expected and what to do.
        line: Line of the file where it was found, counted from 1.
    """

    def __init__(self, path: str | Path, problem: str, line: int | None = None) -> None:
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {problem}")
        self.path = Path(path)
        self.line = line


class MissingExtraError(LatentMotionError):
    """A feature whose optional dependency is not installed."""

    def __init__(self, feature: str, package: str, extra: str) -> None:
        super().__init__(
            f"{feature} needs {package}, which is not installed; "
            f'run: pip install "latentmotion[{extra}]"'
        )


class MissingProgramError(LatentMotionError):
    """A feature that runs another program, which was not found."""


class ReadingWarning(UserWarning):
    """A motion file was read by a guess, or in spite of a small mistake in it."""


def named(kind: str, name: str, table: Mapping[str, Entry]) -> Entry:
    """Returns what a table has of a name.

    Args:
        kind: What the table is of, such as "preset".
        name: The name.
        table: All that have one.

    Raises:
        InputError: It is none of these; the nearest is named.
    """
    if name not in table:
        raise InputError(f"unknown {kind} {name!r}; {hint(name, table)}")
    return table[name]
