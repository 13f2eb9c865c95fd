"""Pickles, read without running code: arrays, lists, dictionaries, text and numbers.

A pickle is a program that may call any function by name. A `RestrictedUnpickler` looks each name up
in its own list and imports nothing; any other name is an error. `load` allows only what rebuilds
plain values (`ALLOWED`); SciPy's sparse matrices, such as SMPL's joint regressor, become dense
arrays.
"""

from __future__ import annotations

import pickle
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from latentmotion.errors import FileFormatError


class _SparseColumns:
    """Stands for SciPy's compressed columns while a pickle is read."""

    data: np.ndarray
    """Values, one column after another."""
    indices: np.ndarray
    """Row of each value."""
    indptr: np.ndarray
    """Where each column begins."""
    _shape: tuple[int, int]

    def dense(self) -> np.ndarray:
        """Returns the whole matrix."""
        whole = np.zeros(self._shape, self.data.dtype)
        columns = np.repeat(np.arange(self._shape[1]), np.diff(self.indptr))
        whole[self.indices, columns] = self.data
        return whole


def _encode(text: str, encoding: str) -> bytes:
    """Makes the bytes that Python 2 and protocol 2 keep as text."""
    return text.encode("latin1" if encoding in ("latin1", "latin-1") else "ascii")


def _reconstructor(cls: type, base: type, state: Any) -> Any:
    """Makes an object as protocol 0 does; of the stand-in alone."""
    if cls is not _SparseColumns or base is not object or state is not None:
        raise pickle.UnpicklingError(f"it makes an object of {cls!r}")
    return _SparseColumns()


_PYTHON_2 = {"__builtin__": "builtins", "copy_reg": "copyreg"}
"""Names of modules in pickles of Python 2."""

_REBUILDERS = {
    "multiarray._reconstruct": np.zeros(1).__reduce__()[0],
    "multiarray.scalar": np.float64(1).__reduce__()[0],
    "numeric._frombuffer": np.zeros(1).__reduce_ex__(5)[0],
}
"""Functions that NumPy's own pickles call, by their names in all its versions."""

ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("_codecs", "encode"): _encode,
    ("collections", "OrderedDict"): OrderedDict,
    ("builtins", "bytes"): bytes,
    ("builtins", "set"): set,
    ("builtins", "frozenset"): frozenset,
    ("builtins", "complex"): complex,
    ("builtins", "bytearray"): bytearray,
    ("builtins", "object"): object,
    ("copyreg", "_reconstructor"): _reconstructor,
    **{
        (f"{package}.{name.partition('.')[0]}", name.partition(".")[2]): function
        for package in ("numpy.core", "numpy._core")
        for name, function in _REBUILDERS.items()
    },
    **{
        (module, "csc_matrix"): _SparseColumns
        for module in ("scipy.sparse.csc", "scipy.sparse._csc", "scipy.sparse")
    },
}
"""Names that a pickle may use, and what it gets for each."""


class ForbiddenName(pickle.UnpicklingError):
    """A pickle named something that is not allowed.

    Args:
        name: What it named.
    """

    def __init__(self, name: str) -> None:
        super().__init__(f"it names {name}")
        self.name = name


class RestrictedUnpickler(pickle.Unpickler):
    """Looks up each name of a pickle in a list, and imports nothing.

    Args:
        file: The open pickle.
        allowed: Module and name → what the pickle gets; raises KeyError for all others.
        encoding: Of text in pickles of Python 2.
    """

    def __init__(self, file: Any, allowed: Callable[[str, str], Any], encoding: str) -> None:
        super().__init__(file, encoding=encoding)
        self._allowed = allowed

    def find_class(self, module: str, name: str) -> Any:
        """Looks a name up.

        Raises:
            ForbiddenName: It is not allowed.
        """
        module = _PYTHON_2.get(module, module)
        try:
            return self._allowed(module, name)
        except KeyError as error:
            raise ForbiddenName(f"{module}.{name}") from error

    def persistent_load(self, pid: Any) -> Any:
        """Refuses objects outside of the pickle.

        Raises:
            ForbiddenName: Always.
        """
        raise ForbiddenName(f"the outside object {pid!r}")


def load(path: str | Path) -> Any:
    """Reads a pickle of plain values, of any protocol, of Python 2 as well.

    Returns:
        Arrays, lists, tuples, dictionaries, sets, text, bytes and numbers, in any nesting.

    Raises:
        FileFormatError: The file is missing, damaged, no pickle, or holds anything else, which
            is named; nothing of it was run.
    """
    try:
        with Path(path).open("rb") as file:
            content = RestrictedUnpickler(file, lambda *name: ALLOWED[name], "latin1").load()
            return _plain(content)
    except ForbiddenName as error:
        chumpy = error.name.startswith("chumpy")
        problem = (_CHUMPY if chumpy else _NOT_PLAIN).format(name=error.name, path=path)
        raise FileFormatError(path, problem) from error
    except OSError as error:
        raise FileFormatError(path, f"cannot be read ({error.strerror or error})") from error
    except Exception as error:  # a damaged pickle fails anywhere inside pickle and NumPy
        problem = f"no pickle of plain values, or damaged ({type(error).__name__}: {error})"
        raise FileFormatError(path, f"{problem}; download it again") from error


def _plain(value: Any) -> Any:
    """Replaces stand-ins, in dictionaries and lists."""
    if isinstance(value, _SparseColumns):
        return value.dense()
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list) else value


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
