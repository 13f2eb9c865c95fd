"""PyTorch files that hold settings of foreign programs beside their tensors, read without them.

A pickle may call any function by name. Here it gets tensors for PyTorch's own names, for the names
that training programs are known to leave behind (`KNOWN`) a thing that does nothing, and for every
other name the reading ends: nothing that is named is ever imported or run.
"""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import torch
from torch import Tensor

from latentmotion.storage.pickles import RestrictedUnpickler

KNOWN_PACKAGES = (
    *("omegaconf.", "antlr4.", "pytorch_lightning.", "lightning.", "lightning_fabric."),
    *("torchmetrics.", "mld.", "typing.", "pathlib.", "collections.", "enum.", "torch.optim."),
    *("numpy.core.multiarray.", "numpy._core.multiarray."),
)
"""Beginnings of names that become a `StandIn`."""

KNOWN = {
    *(f"builtins.{kind.__name__}" for kind in (dict, list, set, frozenset, tuple, object)),
    *(f"builtins.{kind.__name__}" for kind in (int, float, str, bool, complex, bytes)),
    *("numpy.ndarray", "numpy.dtype", "torch.Size", "torch.device"),
    *("builtins.long", "builtins.unicode", "_codecs.encode", "copyreg._reconstructor"),
}
"""Names that do so as well."""

_STORAGES = {
    "FloatStorage": torch.float32,
    "DoubleStorage": torch.float64,
    "HalfStorage": torch.float16,
    "BFloat16Storage": torch.bfloat16,
    "LongStorage": torch.int64,
    "IntStorage": torch.int32,
    "ShortStorage": torch.int16,
    "CharStorage": torch.int8,
    "ByteStorage": torch.uint8,
    "BoolStorage": torch.bool,
}


class StandIn:
    """Takes whatever a pickle does to an object, and keeps none of it."""

    def __new__(cls, *_: Any, **__: Any) -> StandIn:
        """Ignores all arguments."""
        return super().__new__(cls)

    def _ignore(self, *_: Any) -> StandIn:
        return self

    __call__ = __setstate__ = __setitem__ = append = extend = add = _ignore


def read_with_stand_ins(path: Path) -> Any:
    """Returns what a PyTorch file holds: tensors and plain values, a `StandIn` for all else.

    Raises:
        ForbiddenName: It names something unknown.
        Exception: The file is damaged, or no zip file.
    """
    with ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith("/data.pkl")]
        with archive.open(names[0]) as file:
            return _Unpickler(file, archive, names[0].removesuffix(".pkl")).load()


class _Unpickler(RestrictedUnpickler):
    def __init__(self, file: Any, archive: ZipFile, folder: str) -> None:
        super().__init__(file, self._named, encoding="utf-8")
        self._archive, self._folder = archive, folder

    def _named(self, module: str, name: str) -> Any:
        if module == "torch" and name in _STORAGES:
            return _STORAGES[name]
        if module == "torch._utils" and name in ("_rebuild_tensor_v2", "_rebuild_parameter"):
            return getattr(self, name)
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        full = f"{module}.{name}"
        if full in KNOWN or full.startswith(KNOWN_PACKAGES):
            return StandIn
        raise KeyError(full)

    def persistent_load(self, pid: Any) -> Tensor:
        _, dtype, key, _, count = pid
        if count == 0:
            return torch.empty(0, dtype=dtype)
        content = bytearray(self._archive.read(f"{self._folder}/{int(key)}"))
        return torch.frombuffer(content, dtype=dtype, count=count)

    def _rebuild_tensor_v2(
        self, storage: Tensor, offset: int, size: Any, stride: Any, *_: Any
    ) -> Tensor:
        return storage.as_strided(size, stride, offset)

    def _rebuild_parameter(self, tensor: Tensor, *_: Any) -> Tensor:
        return tensor
