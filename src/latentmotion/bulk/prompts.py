"""Prompts of a bulk run: a text file with one a line, or a table of CSV or Parquet."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from latentmotion.errors import FileFormatError, InputError, MissingExtraError
from latentmotion.storage import limits
from latentmotion.storage.reading import read_table, read_text

COLUMNS = ("prompt", "seconds", "seed")
"""Columns of a table that are read; the first is needed."""


@dataclass(frozen=True)
class PromptRow:
    """A requested motion."""

    line: int
    """Its line in the file, counted from 1; in Parquet its row."""
    prompt: str
    """A sentence, a label or nothing."""
    seed: int
    """Seed of its noise."""
    seconds: float | None = None
    """Its length, if it is given."""
    problem: str = ""
    """Its error, if any."""


def read_rows(path: Path, seed: int = 0) -> list[PromptRow]:
    """Reads a file of prompts; wrong numbers are problems of their rows, not errors.

    Args:
        path: A text file with a prompt in every line, or `.csv` or `.parquet` with the columns
            prompt and, if wanted, seconds and seed.
        seed: Seed of the first row; later rows count up from it, unless they have their own.

    Raises:
        FileFormatError: The file cannot be read, lacks the column or has too many rows.
        InputError: It holds no row.
        MissingExtraError: It is Parquet and pyarrow is not installed.
    """
    readers = {".csv": _csv, ".parquet": _parquet}
    read = readers.get(path.suffix.lower(), _lines)(path)
    rows = [_row(line, cells, seed + number) for number, (line, cells) in enumerate(read)]
    if not rows:
        raise InputError(f"{path} holds no prompt; expected one per line")
    if len(rows) > limits.MOST_PROMPTS:
        raise FileFormatError(path, _too_many(len(rows)))
    return rows


def _lines(path: Path) -> Iterable[tuple[int, dict[str, Any]]]:
    lines = io.StringIO(read_text(path), newline=None)
    return [(number, {"prompt": line}) for number, line in enumerate(lines, 1)]


def _csv(path: Path) -> Iterable[tuple[int, dict[str, Any]]]:
    return read_table(path, COLUMNS[:1])


def _parquet(path: Path) -> Iterable[tuple[int, dict[str, Any]]]:
    try:
        from pyarrow import ArrowException, parquet, types
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"reading {path}", "pyarrow", "bulk") from error
    try:
        with parquet.ParquetFile(path) as file:
            count, columns = file.metadata.num_rows, file.schema_arrow.names
            if "prompt" not in columns:
                raise FileFormatError(path, f"lacks the column prompt; found {', '.join(columns)}")
            kind = file.schema_arrow.field("prompt").type
            if not (types.is_string(kind) or types.is_large_string(kind)):
                raise FileFormatError(path, f"the column prompt holds {kind}, expected text")
            if count > limits.MOST_PROMPTS:
                raise FileFormatError(path, _too_many(count))
            table = file.read([name for name in COLUMNS if name in columns])
    except (OSError, ArrowException) as error:
        raise FileFormatError(
            path, f"cannot be read as Parquet, write it again: {error!s:.300}"
        ) from error
    return enumerate(table.to_pylist(), 1)


def _row(line: int, cells: dict[str, Any], seed: int) -> PromptRow:
    prompt, problem = str(cells["prompt"] or "").strip(), ""
    seconds = cells.get("seconds")
    seed_text = cells.get("seed")
    if len(prompt) > limits.MOST_PROMPT:
        problem = f"{len(prompt):,} characters, expected at most {limits.MOST_PROMPT:,}"
        prompt = prompt[: limits.MOST_PROMPT]
    try:
        seconds = None if seconds in (None, "") else float(seconds)
        if seconds is not None and not math.isfinite(seconds):
            raise ValueError
    except (TypeError, ValueError):
        problem, seconds = f"{seconds!r:.80} seconds: expected a number", None
    try:
        seed = seed if seed_text in (None, "") else int(seed_text)
        if not 0 <= seed < 2**63 or (isinstance(seed_text, float) and seed != seed_text):
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        problem = f"seed {seed_text!r:.80}: expected a whole number from 0 up, below 2^63"
    return PromptRow(line, prompt, seed, seconds, problem)


def _too_many(count: int) -> str:
    return f"{count:,} rows, at most {limits.MOST_PROMPTS:,} are read; split the file"
