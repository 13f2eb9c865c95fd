"""Child processes: programs of this package that no working folder adds code to, with limits."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import ModuleType

resource: ModuleType | None
try:
    import resource
except ImportError:  # Windows has no limits of this kind
    resource = None

_ONE_THREAD: Mapping[str, str] = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "PXR_WORK_THREAD_LIMIT"), "1"
)


def command(program: str, *arguments: str) -> list[str]:
    """Returns the words that start a module as a program.

    `-P` keeps the working folder off its path: `python -m` would put it first, and a module
    called `json` in a downloaded folder would run.
    """
    return [sys.executable, "-P", "-m", program, *arguments]


def environment() -> dict[str, str]:
    """Returns a child's environment: one thread, and this process's path without working folder."""
    here = None
    with suppress(FileNotFoundError):  # it was removed, and holds nothing
        here = Path.cwd()
    entries = [entry for entry in sys.path if Path(entry).is_absolute() and Path(entry) != here]
    entries.append(str(Path(__file__).parents[2]))  # last: behind the standard library
    return {**os.environ, **_ONE_THREAD, "PYTHONPATH": os.pathsep.join(entries)}


def limit(what: str, amount: int) -> None:
    """Limits this process, and its children until they choose their own limit.

    Args:
        what: `AS` (bytes of address space), `CPU` (seconds), `FSIZE` (bytes of a file), `CORE`.
        amount: The limit; the system's own hard limit holds where it is lower.
    """
    if resource is not None:
        kind = getattr(resource, f"RLIMIT_{what}")
        _, hard = resource.getrlimit(kind)
        least = amount if hard == resource.RLIM_INFINITY else min(amount, hard)
        resource.setrlimit(kind, (least, hard))


def allow_open_files(count: int) -> None:
    """Lets this process open so many files, as far as the hard limit goes; it never lowers."""
    if resource is not None:
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        unlimited = resource.RLIM_INFINITY
        if soft != unlimited and soft < count:
            most = count if hard == unlimited else min(count, hard)
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
