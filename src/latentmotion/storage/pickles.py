"""Pickles, read without running code: arrays, lists, dictionaries, text and numbers.

A pickle is a program that may call any function by name. A `RestrictedUnpickler` looks each name up
in its own list and imports nothing; any other name is an error. `load` allows only what rebuilds
plain values (`ALLOWED`). NumPy's own functions are not among them, since they trust sizes, types
and addresses: stand-ins collect what arrays are made of, and it is checked. SciPy's sparse
matrices, such as SMPL's joint regressor, become dense arrays.
"""

from __future__ import annotations

import io
import math
import operator
import pickle
import re
import reprlib
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from latentmotion.errors import FileFormatError
from latentmotion.storage import limits, reading


class StandInType:
    """Stands for `numpy.dtype` while a pickle is read.

    Args:
        name: Kind and size, as `f4`.

    Raises:
        UnpicklingError: It is not of numbers, text, bytes or objects.
    """

    def __init__(self, name: Any, *_: Any) -> None:
        name = name.decode("ascii") if isinstance(name, bytes) else name
        if not (isinstance(name, str) and _TYPE.fullmatch(name)):
            raise pickle.UnpicklingError(f"it holds an array of {reprlib.repr(name)}")
        self.dtype = np.dtype(name)

    def __setstate__(self, state: Any) -> None:
        """Takes the order of bytes; refuses types of several fields."""
        if any(part is not None for part in state[2:5]):
            raise pickle.UnpicklingError("it holds an array of several fields")
        if self.dtype.kind != "O" and state[1] in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(state[1])

    def values(self, raw: Any, shape: Any) -> np.ndarray:
        """Returns an array of contents that are as many as its shape says."""
        count = math.prod(shape)
        if min(shape, default=0) < 0 or len(shape) > _MOST_AXES:
            raise pickle.UnpicklingError(f"it holds an array of shape {shape}")
        if self.dtype.kind == "O":
            if not isinstance(raw, list) or len(raw) != count:
                raise pickle.UnpicklingError("it holds an array of objects without its objects")
            values = np.empty(count, object)
            for number, item in enumerate(raw):
                values[number] = item
            return values
        raw = raw.encode("latin1") if isinstance(raw, str) else raw
        if not isinstance(raw, bytes | bytearray) or len(raw) != count * self.dtype.itemsize:
            problem = f"an array of shape {shape} with other contents"
            raise pickle.UnpicklingError(f"it holds {problem} than {count} of {self.dtype}")
        return np.frombuffer(raw, self.dtype) if count else np.zeros(0, self.dtype)


class StandInArray:
    """Stands for `numpy.ndarray` while a pickle is read: nothing is there before its contents."""

    __hash__ = None  # type: ignore[assignment]
    shape: tuple[int, ...]
    fortran: bool
    values: np.ndarray | None = None

    def __setstate__(self, state: Any) -> None:
        """Takes shape, type, order of axes and contents."""
        *_, shape, kind, self.fortran, raw = state
        self.shape = tuple(operator.index(size) for size in shape)
        self.values = kind.values(raw, self.shape)


class _SparseColumns:
    """Stands for SciPy's compressed columns while a pickle is read."""

    data: np.ndarray  # Values, one column after another.
    indices: np.ndarray  # Row of each value.
    indptr: np.ndarray  # Where each column begins.
    _shape: tuple[int, int]

    def dense(self, most: int) -> np.ndarray:
        """Returns the whole matrix.

        Args:
            most: Bytes that it may have.
        """
        rows, columns = (operator.index(size) for size in self._shape)
        size = rows * columns * self.data.dtype.itemsize
        if min(rows, columns) < 0 or size > most or self.data.dtype.kind not in "fiu":
            raise pickle.UnpicklingError(f"it holds a sparse matrix of shape {self._shape}")
        counts = np.diff(self.indptr)
        if len(counts) != columns or len(self.indices) != len(self.data) or (counts < 0).any():
            raise pickle.UnpicklingError("it holds a sparse matrix that contradicts itself")
        if len(self.indices) and not 0 <= self.indices.min() <= self.indices.max() < rows:
            raise pickle.UnpicklingError("it holds a sparse matrix with rows outside of it")
        whole = np.zeros((rows, columns), self.data.dtype)
        whole[self.indices, np.repeat(np.arange(columns), counts)] = self.data
        return whole


def _reconstruct(cls: type, *_: Any) -> StandInArray:
    """Makes an array that has no contents yet, as NumPy's pickles do."""
    if cls is not StandInArray:
        raise pickle.UnpicklingError(f"it makes an array of {cls!r}")
    return StandInArray()


def _from_buffer(raw: Any, kind: StandInType, shape: Any, order: str) -> StandInArray:
    """Makes an array as protocol 5 does."""
    array = StandInArray()
    array.__setstate__((shape, kind, order == "F", raw))
    return array


def _scalar(kind: StandInType, raw: Any = None) -> Any:
    """Makes a number of NumPy's."""
    if kind.dtype.kind == "O":
        raise pickle.UnpicklingError("it holds an object as a number")
    return kind.values(raw, (1,))[0]


def _bytes(cls: type) -> Callable[..., Any]:
    """Returns what makes bytes, of given contents but not of a number."""

    def make(*contents: Any) -> Any:
        if contents and not isinstance(contents[0], bytes | bytearray | str):
            raise pickle.UnpicklingError(f"it makes {cls.__name__} of a {type(contents[0])}")
        return cls(*contents)

    return make


def _reconstructor(cls: type, base: type, state: Any) -> Any:
    """Makes an object as protocol 0 does; of the stand-in alone."""
    if cls is not _SparseColumns or base is not object or state is not None:
        raise pickle.UnpicklingError(f"it makes an object of {cls!r}")
    return _SparseColumns()


_TYPE = re.compile(r"[<>|=]?(b1|[iu][1248]|f(2|4|8|16)|c(8|16)|[SU]\d{1,6}|O8?|[?bhilqBHILQefdg])")
_MOST_AXES = 32

# Names of modules in pickles of Python 2.
PYTHON_2 = {"__builtin__": "builtins", "copy_reg": "copyreg"}

# Names that a pickle may use, and what it gets for each.
ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): StandInArray,
    ("numpy", "dtype"): StandInType,
    # Bytes that Python 2 and protocol 2 keep as text.
    ("_codecs", "encode"): lambda text, encoding: text.encode(
        "latin1" if encoding in ("latin1", "latin-1") else "ascii"
    ),
    ("collections", "OrderedDict"): OrderedDict,
    ("builtins", "bytes"): _bytes(bytes),
    ("builtins", "set"): set,
    ("builtins", "frozenset"): frozenset,
    ("builtins", "complex"): complex,
    ("builtins", "bytearray"): _bytes(bytearray),
    ("builtins", "object"): object,
    ("copyreg", "_reconstructor"): _reconstructor,
    **{  # functions that NumPy's own pickles call, by their names in all its versions
        (f"{package}.{module}", name): function
        for package in ("numpy.core", "numpy._core")
        for module, name, function in (
            ("multiarray", "_reconstruct", _reconstruct),
            ("multiarray", "scalar", _scalar),
            ("numeric", "_frombuffer", _from_buffer),
        )
    },
    **{
        (module, "csc_matrix"): _SparseColumns
        for module in ("scipy.sparse.csc", "scipy.sparse._csc", "scipy.sparse")
    },
}


class ForbiddenName(pickle.UnpicklingError):
    """A pickle named something that is not allowed.

    Args:
        name: What it named.
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"it names {name}")
        self.name = name


# The unpickler in Python: the one in C takes memory for a number before it looks what follows, and
# cannot stop between two instructions.
_InPython: Any = pickle._Unpickler  # type: ignore[attr-defined]


class RestrictedUnpickler(_InPython):
    """Looks up each name of a pickle in a list, and imports nothing.

    Args:
        file: The pickle.
        allowed: Module and name → what the pickle gets; raises KeyError for all others.
        encoding: Of text in pickles of Python 2.
    """

    dispatch: ClassVar[dict[int, Any]] = dict(_InPython.dispatch)

    def __init__(self, file: io.BytesIO, allowed: Callable[[str, str], Any], encoding: str) -> None:
        super().__init__(file, encoding=encoding)
        self._file, self._allowed = file, allowed

    def find_class(self, module: str, name: str) -> Any:
        """Looks a name up.

        Raises:
            ForbiddenName: It is not allowed.
        """
        module = PYTHON_2.get(module, module)
        try:
            return self._allowed(module, name)
        except KeyError as error:
            raise ForbiddenName(f"{module}.{name}") from error

    def persistent_load(self, pid: Any) -> Any:
        """Refuses objects outside of the pickle.

        Raises:
            ForbiddenName: There is one.
        """
        raise ForbiddenName(f"the outside object {pid!r}")

    def load_bytearray8(self) -> None:
        """Reads bytes that are there."""
        size = int.from_bytes(self.read(8), "little")
        if size > len(self._file.getbuffer()):
            raise pickle.UnpicklingError("pickle data was truncated")
        self.append(bytearray(self.read(size)))

    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8


def load(path: str | Path) -> Any:
    """Reads a pickle of plain values, of any protocol, of Python 2 as well.

    Returns:
        Arrays, lists, tuples, dictionaries, sets, text, bytes and numbers, in any nesting.

    Raises:
        FileFormatError: The file is missing, damaged, no pickle, or holds anything else, which
            is named; nothing of it was run.
    """
    content = reading.read_bytes(path)
    program = RestrictedUnpickler(io.BytesIO(content), lambda *name: ALLOWED[name], "latin1")
    return plain_values(path, len(content), program.load)


def plain_values(path: str | Path, size: int, loaded: Callable[[], Any]) -> Any:
    """Returns what a restricted reader makes of a file, stand-ins replaced by their values.

    Args:
        path: The file, for errors.
        size: Bytes of the file, unpacked, which bound what it may hold.
        loaded: The reader.

    Raises:
        FileFormatError: The reader failed, for any reason.
    """
    try:
        return _Plain(size).value(loaded())
    except FileFormatError:
        raise
    except ForbiddenName as error:
        chumpy = error.name.startswith("chumpy")
        problem = (_CHUMPY if chumpy else _NOT_PLAIN).format(name=error.name, path=path)
        raise FileFormatError(path, problem) from error
    except Exception as error:  # a damaged pickle fails anywhere inside pickle and NumPy
        problem = f"no pickle of plain values, or damaged ({type(error).__name__}: {error})"
        raise FileFormatError(path, f"{problem}; download it again") from error


class _Plain:
    """Replaces stand-ins by the values they stand for, each once however often it is referred to.

    Args:
        size: Bytes of the pickle, which bound what it may hold.
    """

    def __init__(self, size: int) -> None:
        self._free = 2 * size + 1024  # bytes of arrays; contents may be referred to twice
        self._most = max(limits.UNPACKED_FREE, limits.UNPACKED_FACTOR * size)
        self._made: dict[int, tuple[Any, Any, int]] = {}
        self._open: set[int] = set()

    def value(self, value: Any) -> Any:
        """Returns a value without stand-ins.

        Raises:
            UnpicklingError: It refers to itself, or to its parts so often that it has far more
                than the pickle.
        """
        return self._sized(value)[0]

    def _sized(self, value: Any) -> tuple[Any, int]:
        """Returns the plain value, and how many values it has, counted at every reference."""
        if not isinstance(value, _CONTAINERS):
            return value, 1
        earlier = self._made.get(id(value))
        if earlier is not None:
            return earlier[1], earlier[2]
        if id(value) in self._open:
            raise pickle.UnpicklingError("it holds something that holds itself")
        self._open.add(id(value))
        plain, size = self._replaced(value)
        if size > self._most:
            raise pickle.UnpicklingError("it repeats its contents by reference too often")
        self._open.remove(id(value))
        self._made[id(value)] = value, plain, size  # kept, so that no other gets its id
        return plain, size

    def _replaced(self, value: Any) -> tuple[Any, int]:
        if isinstance(value, StandInArray):
            values, size = value.values, 0
            if values is None:
                raise pickle.UnpicklingError("it holds an array without contents")
            self._free -= values.nbytes
            if self._free < 0:
                raise pickle.UnpicklingError("it repeats its contents by reference too often")
            values = values.copy()
            if values.dtype == object:
                for number, item in enumerate(values):
                    values[number], count = self._sized(item)
                    size += count
            order = "F" if value.fortran else "C"
            return values.reshape(value.shape, order=order), 1 + size + values.size
        if isinstance(value, _SparseColumns):
            for name, part in list(vars(value).items()):
                setattr(value, name, self._sized(part)[0])
            whole = value.dense(self._most)
            return whole, whole.size
        if isinstance(value, dict):
            pairs = [(self._sized(key)[0], self._sized(item)) for key, item in value.items()]
            return {key: item for key, (item, _) in pairs}, 1 + sum(n for _, (_, n) in pairs)
        items = [self._sized(item) for item in value]
        size = 1 + sum(count for _, count in items)
        plain = (item for item, _ in items)
        return (list(plain) if isinstance(value, list) else tuple(plain)), size


_CONTAINERS = (list, tuple, dict, StandInArray, _SparseColumns)

_NOT_PLAIN = (
    "holds {name}, expected only arrays, lists, dictionaries, text and numbers; it was not read, "
    "because a pickle that names other things can run any program"
)
_CHUMPY = (
    "holds {name}; arrays of chumpy cannot be read here, since that package no longer runs. Where "
    'it does (Python 3.10, numpy 1.23, chumpy, scipy), convert the file once: python -c "import '
    "pickle, numpy as n; m = pickle.load(open('{path}', 'rb'), encoding='latin1'); n.savez("
    "'smpl.npz', **{{k: n.asarray(m[k].todense() if hasattr(m[k], 'todense') else m[k]) for k in "
    "('v_template', 'shapedirs', 'posedirs', 'J_regressor', 'weights', 'kintree_table', 'f')}})\" "
    "and pass smpl.npz"
)
