"""Progress: bars with the time left on a terminal, and a line in every minute without output."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from shutil import get_terminal_size
from threading import Event, Thread
from time import monotonic
from typing import Any, TypeVar

Item = TypeVar("Item")

DELAY = 2.0  # Seconds after which a bar is shown; what ends before that shows none.

SILENT = 60.0  # Seconds without any output after which a line says that the job goes on.

# The open bars; None where none are shown.
_BARS: ContextVar[list[Any] | None] = ContextVar("bars", default=None)


@dataclass
class _Job:
    """What a job last said, and what it is doing."""

    start: float = field(default_factory=monotonic)
    last: float = field(default_factory=monotonic)
    doing: str = ""


class _Noticed:
    """A stream that notes when something is written to it."""

    def __init__(self, stream: Any, job: _Job) -> None:
        self._stream, self._job = stream, job

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        self._job.last = monotonic()
        return self._stream.write(text)


# The job of the command line; None in a library.
_JOB: ContextVar[_Job | None] = ContextVar("job", default=None)


@contextmanager
def shown_progress(quiet: bool = False) -> Iterator[None]:
    """Shows the progress of what runs inside on standard error.

    On a terminal there are bars; wherever it goes, a line follows every minute without output.

    Args:
        quiet: Whether nothing is shown, as for output that a program reads.
    """
    if quiet or sys.stderr is None or sys.stdout is None:
        yield
        return
    bars: list[Any] = []
    job, ended, (out, err) = _Job(), Event(), (sys.stdout, sys.stderr)
    tokens = _BARS.set(bars if err.isatty() else None), _JOB.set(job)

    def tell() -> None:
        while not ended.wait(max(job.last + SILENT - monotonic(), 0.01)):
            if monotonic() - job.last >= SILENT:
                minutes = round((monotonic() - job.start) / 60)
                doing = f", {job.doing}" if job.doing else ""
                print(f"still running after {minutes} min{doing}", file=err, flush=True)
                job.last = monotonic()

    sys.stdout, sys.stderr = _Noticed(out, job), _Noticed(err, job)
    Thread(target=tell, daemon=True).start()
    try:
        yield
    finally:
        ended.set()
        sys.stdout, sys.stderr = out, err
        _BARS.reset(tokens[0])
        _JOB.reset(tokens[1])
        for bar in bars:  # those that an error left
            bar.close()


def counted(items: Iterable[Item], name: str, done: int = 0) -> Iterable[Item]:
    """Yields items; inside `shown_progress` on a terminal with a bar, from two items up.

    Args:
        items: What is worked on.
        name: What is done with them, e.g. `reading`.
        done: Number of items done before.
    """
    bars, job = _BARS.get(), _JOB.get()
    total = done + len(items) if isinstance(items, Sized) else None
    if job is not None:
        items = _noted(items, name, total, done, job)
    if bars is None or (total is not None and total < 2):
        return items
    try:
        # It comes with tokenizers, by way of huggingface_hub; without it nothing is shown.
        from tqdm import tqdm
    except ModuleNotFoundError:
        return items
    columns, rows = get_terminal_size()  # 80 and 24 where the terminal does not say
    bar = tqdm(
        items,
        name,
        total,
        leave=False,
        file=sys.stderr,
        ncols=columns - 1,
        nrows=rows,
        delay=DELAY,
        initial=done,
    )
    bars[:] = [bar for bar in bars if not bar.disable]  # tqdm disables what it has closed
    bars.append(bar)
    return bar


def _noted(
    items: Iterable[Item], name: str, total: int | None, done: int, job: _Job
) -> Iterator[Item]:
    """Yields items and notes how many there were, for the line of a silent minute."""
    before = job.doing
    for number, item in enumerate(items, done + 1):
        job.doing = f"{name} {number}" + ("" if total is None else f" of {total}")
        yield item
    job.doing = before or f"{name} is done"
