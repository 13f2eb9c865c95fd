"""NumPy's files, `.npz` and `.npy`: plain arrays of numbers or text, whose sizes are checked first.

An array of an `.npz` is read only if it is asked for, and its header is compared with the size of
its member before it is unpacked. Nothing is unpickled.
"""

from __future__ import annotations

import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from latentmotion.errors import FileFormatError
from latentmotion.storage import files, limits

# Names of arrays to read, or a predicate on names.
ArrayFilter = Callable[[str], bool] | Collection[str]

_KINDS = "biufU"
_PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 0x1
# Errors that NumPy and zipfile raise for damaged files.
DAMAGE = (
    *(OSError, EOFError, ValueError, TypeError, SyntaxError, OverflowError, MemoryError),
    *(struct.error, tokenize.TokenError, zlib.error, zipfile.BadZipFile, RuntimeError),
)


def read_arrays(path: str | Path, select: ArrayFilter) -> dict[str, np.ndarray]:
    """Reads arrays of an `.npz` file.

    Args:
        path: The file.
        select: Names of the arrays to read, or a predicate on names; names that the file lacks are
            left out.

    Raises:
        FileFormatError: It is no `.npz`, damaged, or one of these arrays is too large or not of
            numbers or text.
    """
    is_selected = select if callable(select) else select.__contains__
    with _archive(path) as archive:
        names = archive.namelist()
        if len(set(names)) < len(names):
            raise FileFormatError(path, "holds two arrays of one name; save it again")
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        members = {name: info for name, info in members.items() if is_selected(name)}
        check_members(path, list(members.values()))
        arrays = {}
        for name, info in members.items():
            with archive.open(info) as member:
                arrays[name] = _array(path, name, member, info.file_size)
        return arrays


def names_in(path: str | Path) -> list[str]:
    """Returns the names of the arrays of an `.npz` file.

    Raises:
        FileFormatError: It is no `.npz`, or damaged.
    """
    with _archive(path) as archive:
        return [name.removesuffix(".npy") for name in archive.namelist()]


def read_array(path: str | Path) -> np.ndarray:
    """Reads an `.npy` file.

    Raises:
        FileFormatError: It is no `.npy`, damaged, or not of numbers or text.
    """
    with _damage(path), Path(path).open("rb") as opened:
        return _array(path, "", opened, Path(path).stat().st_size)


def holds_objects(path: str | Path) -> bool:
    """Returns whether an `.npy` file holds objects instead of numbers: a pickle.

    Raises:
        FileFormatError: It is no `.npy`, or damaged.
    """
    with _damage(path), Path(path).open("rb") as opened:
        return read_header(opened)[2].hasobject


def write_arrays(path: str | Path, arrays: Mapping[str, Any]) -> None:
    """Writes an `.npz` file, whatever its ending.

    Raises:
        InputError: The folder does not exist or cannot be written.
    """
    # NumPy adds .npz to names that end otherwise, as in capitals, so it gets an open file.
    with files.atomic_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def check_members(path: str | Path, members: Collection[zipfile.ZipInfo]) -> None:
    """Checks the members of a zip archive before they are unpacked.

    Raises:
        FileFormatError: One is encrypted or packed in an unusual way, or they would become too
            large.
    """
    odd = [m for m in members if m.flag_bits & _ENCRYPTED or m.compress_type not in _PLAIN]
    if odd:
        raise FileFormatError(path, f"{odd[0].filename} is encrypted or packed in an unknown way")
    packed, unpacked = Path(path).stat().st_size, sum(member.file_size for member in members)
    most = max(limits.UNPACKED_FREE, limits.UNPACKED_FACTOR * packed)
    most = min(most, max(limits.MOST_UNPACKED, packed))
    if unpacked > most:
        problem = f"{packed:,} bytes would unpack to {unpacked:,}, at most {most:,} are read"
        raise FileFormatError(path, problem)


def read_header(
    file: BinaryIO | Any, where: str = "the array"
) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Returns shape, order and type of an array, as its header says.

    Raises:
        ValueError: It is damaged, or of another version.
    """
    version = np.lib.format.read_magic(file)
    headers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in headers:
        raise ValueError(f"{where} is of the version {version} of .npy")
    return headers[version](file)


def _array(path: str | Path, name: str, file: BinaryIO | Any, size: int) -> np.ndarray:
    """Reads an array of a file of so many bytes, once its header says that it fits."""
    where = f"the array {name!r}" if name else "the array"
    shape, fortran, dtype = read_header(file, where)
    if dtype.kind not in _KINDS or dtype.hasobject or dtype.names:
        raise FileFormatError(path, f"{where} holds {dtype}, expected numbers or text")
    count = math.prod(shape)
    if min(shape, default=0) < 0 or count * dtype.itemsize > size:
        raise FileFormatError(path, f"{where} of shape {shape} is larger than the file; cut short?")
    content = bytearray(file.read(count * dtype.itemsize))
    if len(content) < count * dtype.itemsize:
        raise FileFormatError(path, f"{where} of shape {shape} is cut short")
    if dtype.kind == "U":
        codes = np.frombuffer(content, np.dtype("u4").newbyteorder(dtype.byteorder))
        if not ((codes <= 0x10FFFF) & (codes >> 11 != 0x1B)).all():  # 0x1B: halves of characters
            raise FileFormatError(path, f"{where} holds characters that do not exist")
    return np.ndarray(shape, dtype, content, order="F" if fortran else "C")


@contextmanager
def _archive(path: str | Path) -> Iterator[zipfile.ZipFile]:
    with _damage(path), Path(path).open("rb") as opened:
        if not zipfile.is_zipfile(opened):
            problem = "not a motion file, nor another .npz: cut short, or no .npz at all"
            raise FileFormatError(path, problem)
        with zipfile.ZipFile(opened) as archive:
            yield archive


@contextmanager
def _damage(path: str | Path) -> Iterator[None]:
    try:
        with warnings.catch_warnings(action="ignore"):  # of headers that Python 2 wrote
            yield
    except DAMAGE as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise FileFormatError(
            path, f"cannot be read as NumPy's, save it again: {reason:.300}"
        ) from error
