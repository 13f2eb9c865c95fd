"""Results of research code, read without running any: arrays among plain values.

    joblib      a pickle with the contents of its arrays between its instructions, also by zlib
    PyTorch     a zip archive of a pickle and the contents of its tensors
    NumPy       `.npy` and `.npz` of objects, each a pickle, in which tensors of PyTorch may lie

Names are looked up in a list, as in `pickles.py`, and tensors become arrays, so that PyTorch need
not be there.
"""

from __future__ import annotations

import io
import math
import pickle
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, ClassVar
from zipfile import ZipFile, is_zipfile

import numpy as np

from latentmotion.errors import FileFormatError
from latentmotion.storage import array_files, limits, pickles, reading

# Storages of PyTorch and their types in NumPy; the types that NumPy lacks are not read.
_TYPES = {
    "DoubleStorage": "<f8",
    "FloatStorage": "<f4",
    "HalfStorage": "<f2",
    "LongStorage": "<i8",
    "IntStorage": "<i4",
    "ShortStorage": "<i2",
    "CharStorage": "<i1",
    "ByteStorage": "<u1",
    "BoolStorage": "|b1",
}

# Most bytes by which joblib moves the contents of an array to a whole address.
_BYTES_BEFORE = 16


def load(path: str | Path) -> Any:
    """Reads a file of results.

    Returns:
        Arrays, lists, tuples, dictionaries, sets, text, bytes and numbers, in any nesting.

    Raises:
        FileFormatError: The file is missing, damaged, of no such kind, or names anything else;
            nothing of it was run.
    """
    content = reading.read_bytes(path)
    if content.startswith(b"PK") and is_zipfile(path):
        return _zipped(path)
    if content[:1] == b"\x78":  # zlib's first byte; no pickle begins with it
        most = max(limits.UNPACKED_FREE, limits.UNPACKED_FACTOR * len(content))
        unpacking = zlib.decompressobj()
        with reading.blamed_on(path, zlib.error, problem="packed by zlib, but damaged: {error}"):
            content = unpacking.decompress(content, most)
        if unpacking.unconsumed_tail:
            raise FileFormatError(path, f"would unpack to more than {most:,} bytes")
    if content.startswith(b"\x93NUMPY"):
        return pickles.plain_values(path, len(content), lambda: _objects(content))
    return pickles.plain_values(path, len(content), _Unpickler(io.BytesIO(content)).load)


def _zipped(path: str | Path) -> Any:
    """Reads a file of PyTorch, or each array of an `.npz`."""
    damage = reading.blamed_on(path, *array_files.DAMAGE, problem="a damaged zip archive ({error})")
    with damage, ZipFile(path) as archive:
        array_files.check_members(path, archive.infolist())
        members = {name: archive.read(name) for name in archive.namelist()}
    program = next((name for name in members if name.endswith("/data.pkl")), None)
    if program is None:
        arrays = {name.removesuffix(".npy"): raw for name, raw in members.items()}
        return {
            name: pickles.plain_values(path, len(raw), partial(_objects, raw))
            for name, raw in arrays.items()
        }
    folder = program.removesuffix("data.pkl")

    def stored(key: str) -> bytes:
        return members[f"{folder}data/{key}"]

    size = sum(map(len, members.values()))
    return pickles.plain_values(path, size, _Unpickler(io.BytesIO(members[program]), stored).load)


def _objects(raw: bytes) -> Any:
    """Reads an array of NumPy's, of numbers or of objects."""
    file = io.BytesIO(raw)
    shape, fortran, kind = array_files.read_header(file)
    if kind.hasobject:
        return _Unpickler(file).load()
    return _array(pickles.StandInType(kind.str).values(file.read(), shape), shape, fortran)


def _array(
    values: np.ndarray, shape: tuple[int, ...], fortran: bool = False
) -> pickles.StandInArray:
    array = pickles.StandInArray()
    array.values, array.shape, array.fortran = values, tuple(map(int, shape)), fortran
    return array


class _Storage:
    """Numbers of a tensor.

    Args:
        kind: Type of the numbers.
        raw: Their bytes.
    """

    def __init__(self, kind: str, raw: bytes) -> None:
        kind_of = np.dtype(kind)
        self.values = np.frombuffer(raw[: len(raw) // kind_of.itemsize * kind_of.itemsize], kind_of)


def _rebuilt(
    storage: _Storage, offset: int, size: Any, stride: Any, *_: Any
) -> pickles.StandInArray:
    """Makes a tensor that repeats none of its numbers."""
    size, stride = tuple(map(int, size)), tuple(map(int, stride))
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True))
    if min((*size, *stride, offset), default=0) < 0 or math.prod(size) > len(storage.values):
        raise pickle.UnpicklingError(f"it holds a tensor of shape {size} without its numbers")
    if math.prod(size) == 0:
        return _array(storage.values[:0], size)
    if last >= len(storage.values):
        raise pickle.UnpicklingError(f"it holds a tensor of shape {size} beyond its numbers")
    width = storage.values.itemsize
    strides = tuple(step * width for step in stride)
    view = np.lib.stride_tricks.as_strided(storage.values[offset:], size, strides, writeable=False)
    return _array(view.copy().ravel(), size)


def _storage_of_bytes(raw: bytes) -> _Storage:
    """Reads a storage that PyTorch pickles outside of its own files: five pickles and numbers."""
    file = io.BytesIO(raw)
    for _ in range(3):  # magic number, version, system
        _Unpickler(file).load()
    kind = _Unpickler(file, lambda _: b"").load()
    keys = _Unpickler(file).load()
    if not isinstance(kind, _Storage) or len(keys) != 1:
        raise pickle.UnpicklingError("it holds a storage of PyTorch of an unknown kind")
    count = int.from_bytes(file.read(8), "little")
    return _Storage(kind.values.dtype.str, file.read(count * kind.values.itemsize))


class _JoblibArray:
    """Stands for joblib's array, whose contents follow in the file."""

    shape: tuple[int, ...]
    order: str
    dtype: pickles.StandInType
    numpy_array_alignment_bytes: int | None = None

    def read(self, file: io.BytesIO) -> Any:
        """Returns the array."""
        if self.dtype.dtype.hasobject:
            return _Unpickler(file).load()
        if self.numpy_array_alignment_bytes is not None:
            file.read(min(file.read(1)[0], _BYTES_BEFORE))
        count = math.prod(self.shape) * self.dtype.dtype.itemsize
        if count < 0 or count > len(file.getbuffer()):
            raise pickle.UnpicklingError(f"it holds an array of shape {self.shape}, cut short")
        values = self.dtype.values(file.read(count), self.shape)
        return _array(values, self.shape, self.order == "F")


# Names that a file may use, and what it gets for each.
_NAMES: dict[tuple[str, str], Any] = {
    **pickles.ALLOWED,
    **{("torch", name): kind for name, kind in _TYPES.items()},
    ("torch._utils", "_rebuild_tensor_v2"): _rebuilt,
    ("torch._utils", "_rebuild_parameter"): lambda tensor, *_: tensor,
    ("torch.storage", "_load_from_bytes"): _storage_of_bytes,
    ("torch", "Size"): tuple,
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): _JoblibArray,
    ("collections", "defaultdict"): lambda *_: {},
    ("builtins", "dict"): dict,
    ("builtins", "list"): list,
}


class _Unpickler(pickles.RestrictedUnpickler):
    """Reads a pickle whose arrays may lie outside of it or between its instructions.

    Args:
        file: The pickle, and what follows it.
        stored: Returns the bytes of a storage of PyTorch by its name; None where there are none.
    """

    dispatch: ClassVar[dict[int, Any]] = dict(pickles.RestrictedUnpickler.dispatch)

    def __init__(self, file: io.BytesIO, stored: Callable[[str], bytes] | None = None) -> None:
        super().__init__(file, lambda *name: _NAMES[name], "latin1")
        self._stored = stored

    def persistent_load(self, pid: Any) -> Any:
        """Returns a storage of PyTorch.

        Raises:
            ForbiddenName: It is something else.
        """
        if self._stored is None or not isinstance(pid, tuple) or pid[0] != "storage":
            raise pickles.ForbiddenName(f"the outside object {pid!r}")
        return _Storage(pid[1], self._stored(str(pid[2])))

    def load_build(self) -> None:
        """Reads the contents of an array of joblib's, which follow its description."""
        super().load_build()
        if isinstance(self.stack[-1], _JoblibArray):
            self.stack[-1] = self.stack[-1].read(self._file)

    dispatch[pickle.BUILD[0]] = load_build
