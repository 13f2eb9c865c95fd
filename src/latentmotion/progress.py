"""Progress bars: how much of a long job is done, and the time left."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from shutil import get_terminal_size
from typing import Any, TypeVar

Item = TypeVar("Item")

DELAY = 2.0
"""Seconds after which a bar is shown; what ends before that shows none."""

_BARS: ContextVar[list[Any] | None] = ContextVar("bars", default=None)
"""The open bars; None where none are shown."""


@contextmanager
def shown_progress(quiet: bool = False) -> Iterator[None]:
    """Shows the progress of what runs inside on standard error, if that is a terminal.

    Args:
        quiet: Whether nothing is shown, as for output that a program reads.
    """
    watched = sys.stderr is not None and sys.stderr.isatty()
    bars: list[Any] = []
    token = _BARS.set(bars if watched and not quiet else None)
    try:
        yield
    finally:
        _BARS.reset(token)
        for bar in bars:  # those that an error left
            bar.close()


def counted(
    items: Iterable[Item], name: str, total: int | None = None, done: int = 0
) -> Iterable[Item]:
    """Yields items; inside `shown_progress` with a bar, from two items up.

    Args:
        items: What is worked on.
        name: What is done with them, e.g. `reading`.
        total: Number of items, with those done before; by default the length of `items`.
        done: Number of items done before.
    """
    bars = _BARS.get()
    if total is None and isinstance(items, Sized):
        total = done + len(items)
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
