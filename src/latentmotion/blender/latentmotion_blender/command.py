"""The `latentmotion` command: where it is, and a few calls of it that run beside Blender."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

NAME = "latentmotion"
REMEMBERED = Path(__file__).parent / "command.txt"
"""Holds the path of the command that wrote this add-on, where it was told to."""

_BINARIES = ("bin", "Scripts")
_ENVIRONMENTS = (".venv", "venv", "latentmotion/.venv", "latentmotion", ".local")
_TOOLS = (".local/share/pipx/venvs/latentmotion", ".local/share/uv/tools/latentmotion")
_CONDAS = ("miniconda3", "anaconda3", "miniforge3", "mambaforge")
_BLENDERS_OWN = ("PYTHONHOME", "PYTHONPATH", "LD_LIBRARY_PATH")
"""Variables that Blender sets for its own Python, which would mislead another."""


def find_command(wanted: str = "", project: Path | None = None) -> str | None:
    """Returns the path of the command, or None.

    Args:
        wanted: What the user has set; nothing else is tried then. A folder is looked into.
        project: Folder of the open file, whose environment is tried too.
    """
    if wanted.strip():
        path = Path(wanted.strip()).expanduser()
        return next(filter(None, map(_runnable, [path, *_inside(path)])), None)
    if REMEMBERED.is_file():
        remembered = _runnable(Path(REMEMBERED.read_text(encoding="utf-8").strip()))
        if remembered:
            return remembered
    return shutil.which(NAME) or next(filter(None, map(_runnable, _usual_places(project))), None)


def _usual_places(project: Path | None) -> Iterator[Path]:
    active = [os.environ.get(name) for name in ("VIRTUAL_ENV", "CONDA_PREFIX")]
    environments = [Path(folder) for folder in active if folder]
    if project is not None:
        environments += [project / ".venv", project / "venv"]
    environments += [Path.home() / name for name in (*_ENVIRONMENTS, *_TOOLS, *_CONDAS)]
    for environment in environments:
        yield from _inside(environment)


def _inside(environment: Path) -> list[Path]:
    return [environment / name / NAME for name in _BINARIES] + [environment / NAME]


def _runnable(path: Path) -> str | None:
    for candidate in (path, path.with_name(path.name + ".exe")):
        if candidate.is_file() and os.access(candidate, os.X_OK):
            return str(candidate)
    return None


class Job:
    """Calls of the command, one after another, in processes of their own.

    Args:
        calls: The words of each call, the command first; the next is asked for when one is over.
        folder: Where their output is kept.
    """

    def __init__(self, calls: Iterable[Sequence[str]], folder: Path) -> None:
        self.folder = folder
        self.error = ""
        self._left = iter(calls)
        self._process: subprocess.Popen | None = None

    def is_done(self) -> bool:
        """Looks after the job: starts the next call, notes an error; says whether all is over."""
        if self._process is not None:
            code = self._process.poll()
            if code is None:
                return False
            self._process = None
            if code:
                self._give_up(self._complaint(code))
        call = next(self._left, None)
        if call is not None:
            self._start(call)
        return self._process is None

    def wait(self) -> None:
        """Runs all calls and comes back when they are over."""
        while not self.is_done():
            if self._process is not None:
                self._process.wait()

    def cancel(self) -> None:
        """Ends the call that runs and forgets the others."""
        self._left = iter(())
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _start(self, call: Sequence[str]) -> None:
        environment = {k: v for k, v in os.environ.items() if k not in _BLENDERS_OWN}
        window = getattr(subprocess, "CREATE_NO_WINDOW", 0)
        try:
            with (self.folder / "out.txt").open("wb") as out, self._errors().open("wb") as err:
                self._process = subprocess.Popen(
                    list(call),
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=err,
                    env=environment | {"PYTHONIOENCODING": "utf-8"},
                    creationflags=window,
                )
        except OSError as error:
            self._give_up(f"cannot run {call[0]}: {error.strerror}")

    def _give_up(self, problem: str) -> None:
        self.error, self._left = problem, iter(())

    def _errors(self) -> Path:
        return self.folder / "errors.txt"

    def _complaint(self, code: int) -> str:
        """Returns the line with which the command says what is wrong."""
        text = self._errors().read_text(encoding="utf-8", errors="replace")
        lines = [line.strip() for line in text.splitlines() if line.strip(" │╭╮╰╯─")]
        said = [line for line in lines if line.startswith("error: ")]
        if said:
            return said[-1].removeprefix("error: ")
        return lines[-1].strip("│ ") if lines else f"the command ended with code {code}"
