"""Reading files from anywhere: text, tables, JSON and xz, each in one way, within `limits`."""

from __future__ import annotations

import csv
import io
import json
import lzma
import math
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from latentmotion.errors import FileFormatError, InputError, unreadable
from latentmotion.storage import limits

_OUTSIDE_BRACKETS = re.compile(r'"[^"\\]*(?:\\.[^"\\]*)*"|[^][{}"]+', re.DOTALL)
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
# Characters of a field, from Python's own reader.
_CELL_LIMIT = 131_072


@contextmanager
def blamed_on(
    path: str | Path, *kinds: type[Exception], problem: str = "{error}"
) -> Iterator[None]:
    """Turns errors of what a file holds into errors of the file.

    Args:
        path: The file.
        kinds: Classes of the errors; by default InputError.
        problem: What is said of the file, around `{error}`.

    Raises:
        FileFormatError: The block raised one of them.
    """
    caught = kinds or (InputError,)
    try:
        yield
    except caught as error:
        raise FileFormatError(path, problem.format(error=error)) from error


def read_bytes(path: str | Path, most: int = limits.MOST_UNPACKED) -> bytes:
    """Reads a file.

    Args:
        path: The file.
        most: Bytes that it may have.

    Raises:
        FileFormatError: It cannot be read, or is larger.
    """
    try:
        with Path(path).open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            content = b"" if size > most else file.read()
    except (OSError, ValueError) as error:  # ValueError: a name with NUL
        raise FileFormatError(path, f"cannot be read: {unreadable(error)}") from error
    if max(size, len(content)) > most:
        raise FileFormatError(path, f"has more than {most:,} bytes, the most that is read")
    return content


def read_text(path: str | Path, otherwise: str | None = None) -> str:
    """Reads a text file in UTF-8.

    Args:
        path: The file.
        otherwise: The encoding of files that are not in UTF-8, if they may have another.

    Raises:
        FileFormatError: It cannot be read, is too large or is no text.
    """
    content = read_bytes(path, limits.MOST_TEXT)
    if b"\0" in content:
        raise FileFormatError(path, "holds binary data; expected a text file")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if otherwise:
            return content.decode(otherwise)
        line = content.count(b"\n", 0, error.start) + 1
        problem = f"found the byte 0x{content[error.start]:02x}, which is not UTF-8"
        raise FileFormatError(path, f"{problem}; save it as UTF-8", line) from error


def read_table(path: str | Path, needed: Sequence[str]) -> list[tuple[int, dict[str, str]]]:
    """Reads a CSV file with a header.

    Args:
        path: The file.
        needed: Columns that it must have.

    Returns:
        The line and the cells of each row; cells that a row lacks are empty.

    Raises:
        FileFormatError: It cannot be read, is no CSV or lacks a column.
    """
    table = csv.DictReader(io.StringIO(read_text(path), newline=""), restval="")
    try:
        columns = table.fieldnames or ()
        missing = [name for name in needed if name not in columns]
        if missing:
            raise FileFormatError(
                path,
                f"lacks the column {', '.join(missing)}; found {', '.join(columns) or 'nothing'}",
            )
        return [(table.line_num, row) for row in table]
    except csv.Error as error:
        problem = f"not CSV ({error}); a cell has at most {_CELL_LIMIT:,} characters"
        raise FileFormatError(path, problem, table.line_num) from error


def csv_rows(path: str | Path, lines: Iterable[str]) -> list[list[str]]:
    """Returns the cells of lines of CSV.

    Raises:
        FileFormatError: It is no CSV.
    """
    with blamed_on(path, csv.Error, problem="not CSV ({error})"):
        return list(csv.reader(lines))


def packaged_toml(module: str, name: str) -> dict[str, Any]:
    """Returns the table of a TOML file that lies beside a module of this package.

    Args:
        module: The module's `__file__`.
        name: Name of the file.
    """
    return tomllib.loads(Path(module).with_name(name).read_text(encoding="utf-8"))


def read_json_file(path: str | Path) -> Any:
    """Reads a JSON file as plain values; see `parse_json`."""
    return parse_json(read_bytes(path, limits.MOST_JSON), path)


def parse_json(content: str | bytes, path: str | Path) -> Any:
    """Returns JSON as plain values, whose numbers are finite and whose text can be written.

    Args:
        content: The JSON; bytes are UTF-8.
        path: The file that it is from, for errors.

    Raises:
        FileFormatError: It is no JSON, too large or nested too deep.
    """
    if len(content) > limits.MOST_JSON:
        problem = f"JSON of {len(content):,} characters, at most {limits.MOST_JSON:,} are read"
        raise FileFormatError(path, problem)
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        value = json.loads(text, parse_constant=_number, parse_float=_number, parse_int=_whole)
        if _SURROGATE.search(text):  # halves of a character, which cannot be written
            json.dumps(value, ensure_ascii=False).encode()
    except UnicodeError as error:
        raise FileFormatError(path, f"is not JSON: it holds no UTF-8 text ({error})") from error
    except json.JSONDecodeError as error:
        raise FileFormatError(path, f"is not JSON: {error.msg}", error.lineno) from error
    except ValueError as error:
        raise FileFormatError(path, f"is not JSON that can be read: {error}") from error
    except RecursionError as error:
        raise FileFormatError(path, _TOO_DEEP) from error
    brackets = _OUTSIDE_BRACKETS.sub("", text)
    for _ in range(limits.MOST_NESTING):
        brackets = brackets.replace("[]", "").replace("{}", "")
    if brackets:
        raise FileFormatError(path, _TOO_DEEP)
    return value


def unpack_xz(path: str | Path) -> bytes:
    """Returns the content of an `.xz` file.

    Raises:
        FileFormatError: It cannot be read, is damaged, or becomes too large.
    """
    packed = read_bytes(path)
    allowed = max(limits.UNPACKED_FREE, limits.UNPACKED_FACTOR * len(packed))
    most = min(limits.MOST_JSON, allowed)
    decompressor = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=limits.XZ_MEMORY)
    try:
        plain = decompressor.decompress(packed, max_length=most + 1)
    except (lzma.LZMAError, EOFError) as error:
        raise FileFormatError(path, f"damaged ({error}); copy it again") from error
    if len(plain) > most:
        raise FileFormatError(path, f"{len(packed):,} bytes unpack to more than {most:,}")
    if not decompressor.eof:
        raise FileFormatError(path, "damaged (it is cut short); copy it again")
    return plain


def _number(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"found {text}, expected a finite number")
    return number


def _whole(text: str) -> int:
    # Counted before `int`, whose time is quadratic in the digits.
    if len(text) > limits.MOST_DIGITS + 1 or not -(2**63) <= (number := int(text)) < 2**63:
        raise ValueError(f"found a whole number of {len(text)} digits, expected one of 64 bits")
    return number


_TOO_DEEP = f"JSON nested more than {limits.MOST_NESTING} levels deep; expected fewer"
