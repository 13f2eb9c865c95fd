"""The `latentmotion` command: finding it, and running it in the background."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path

NAME = "latentmotion"
# File with the path of the command that wrote this add-on, if any.
REMEMBERED = Path(__file__).parent / "command.txt"

_BINARIES = ("bin", "Scripts")
_ENVIRONMENTS = (".venv", "venv", "latentmotion/.venv", "latentmotion", ".local")
_TOOLS = (".local/share/pipx/venvs/latentmotion", ".local/share/uv/tools/latentmotion")
_CONDAS = ("miniconda3", "anaconda3", "miniforge3", "mambaforge")
# Variables that Blender sets for its own Python, which would mislead another.
_BLENDERS_OWN = ("PYTHONHOME", "PYTHONPATH", "LD_LIBRARY_PATH")


def find_command(preferred: str = "", project: Path | None = None) -> str | None:
    """Returns the path of the command, or None.

    Args:
        preferred: Path that the user has set, a command or its folder; nothing else is tried then.
        project: Folder of the open file, whose environment is tried too.
    """
    if preferred.strip():
        path = Path(preferred.strip()).expanduser()
        return next(filter(None, map(_runnable, [path, *_inside(path)])), None)
    if REMEMBERED.is_file():
        remembered = _runnable(Path(REMEMBERED.read_text(encoding="utf-8").strip()))
        if remembered:
            return remembered
    installed = shutil.which(NAME)
    if installed:
        return installed
    active = [os.environ.get(name) for name in ("VIRTUAL_ENV", "CONDA_PREFIX")]
    environments = [Path(folder) for folder in active if folder]
    if project is not None:
        environments += [project / ".venv", project / "venv"]
    environments += [Path.home() / name for name in (*_ENVIRONMENTS, *_TOOLS, *_CONDAS)]
    candidates = [path for environment in environments for path in _inside(environment)]
    return next(filter(None, map(_runnable, candidates)), None)


def _inside(environment: Path) -> list[Path]:
    return [environment / name / NAME for name in _BINARIES] + [environment / NAME]


def _runnable(path: Path) -> str | None:
    for candidate in (path, path.with_name(path.name + ".exe")):
        if candidate.is_file() and os.access(candidate, os.X_OK):
            return str(candidate)
    return None


class CommandJob:
    """Calls of the command, one after another, in processes of their own.

    Args:
        calls: The words of each call, the command first; drawn one by one as calls end.
        folder: Folder for their output.
    """

    def __init__(self, calls: Iterable[Sequence[str]], folder: Path) -> None:
        self.folder = folder
        self.error = ""
        self._calls = iter(calls)
        self._process: subprocess.Popen | None = None

    def is_done(self) -> bool:
        """Polls the job: starts the next call, keeps an error; returns whether all is over."""
        errors = self.folder / "errors.txt"
        if self._process is not None:
            code = self._process.poll()
            if code is None:
                return False
            self._process = None
            if code:
                text = errors.read_text(encoding="utf-8", errors="replace")
                lines = [line.strip() for line in text.splitlines() if line.strip(" │╭╮╰╯─")]
                problem = lines[-1].strip("│ ") if lines else f"the command ended with code {code}"
                marked = [line for line in lines if line.startswith("error: ")]
                self._give_up(marked[-1].removeprefix("error: ") if marked else problem)
        call = next(self._calls, None)
        if call is None:
            return True
        environment = {k: v for k, v in os.environ.items() if k not in _BLENDERS_OWN}
        try:
            with (self.folder / "out.txt").open("wb") as out, errors.open("wb") as err:
                self._process = subprocess.Popen(
                    list(call),
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=err,
                    env=environment | {"PYTHONIOENCODING": "utf-8"},
                    creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                )
        except OSError as error:
            self._give_up(f"cannot run {call[0]}: {error.strerror}")
        return self._process is None

    def wait(self) -> None:
        """Runs all calls and returns when they are over."""
        while not self.is_done():
            if self._process is not None:
                self._process.wait()

    def cancel(self) -> None:
        """Ends the running call and drops the others."""
        self._calls = iter(())
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def _give_up(self, problem: str) -> None:
        self.error, self._calls = problem, iter(())
