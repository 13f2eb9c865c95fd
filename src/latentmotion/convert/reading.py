"""Reading foreign checkpoints without running code inside them; their names of weights.

Such files hold settings of foreign programs beside their tensors, and a pickle may call any
function by name. Here PyTorch's own names get tensors, names that training programs are known to
leave behind (`KNOWN`) get a placeholder that does nothing, and any other name ends the reading:
nothing that is named is ever imported or run.

The authors pack queries, keys and values of every attention into `in_proj`; cross-attention here
keeps the queries apart. Fixed sine tables, which they store, are compared with the formula and
dropped.
"""

from __future__ import annotations

import io
import math
import pickle
import pickletools
import re
import warnings
from collections import Counter, OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import ZipFile, is_zipfile

import torch
from torch import Tensor

from latentmotion import formats
from latentmotion.errors import ModelError
from latentmotion.networks.transformer import LEARNED_LENGTH, sine_rate, sines
from latentmotion.storage import array_files, pickles
from latentmotion.storage.reading import packaged_toml

# Networks that are converted, by the first part of their weights' names; all others are not.
PARTS = ("vae", "denoiser")

# Prefixes of names that become a `Placeholder`.
KNOWN_PACKAGES = (
    *("omegaconf.", "antlr4.", "pytorch_lightning.", "lightning.", "lightning_fabric."),
    *("torchmetrics.", "mld.", "typing.", "pathlib.", "collections.", "enum.", "torch.optim."),
    *("numpy.core.multiarray.", "numpy._core.multiarray."),
)

# Further names that become a `Placeholder`.
KNOWN = {
    *(f"builtins.{kind.__name__}" for kind in (dict, list, set, frozenset, tuple, object)),
    *(f"builtins.{kind.__name__}" for kind in (int, float, str, bool, complex, bytes)),
    *("numpy.ndarray", "numpy.dtype", "torch.Size", "torch.device"),
    *("builtins.long", "builtins.unicode", "_codecs.encode", "copyreg._reconstructor"),
}

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


# Times that tensors may repeat stored numbers, such as weights that two networks share.
_MOST_SHARED = 8


def read_checkpoint(path: str | Path) -> dict[str, Tensor]:
    """Returns the tensors of a Lightning file's `state_dict`, or of a plain dictionary of tensors.

    MDM's newer files hold `model_avg`, the average of the weights, beside `model`.

    Raises:
        ModelError: The file is missing, damaged, of another kind, or holds code.
    """
    content = read_content(Path(path))
    states = [content]
    if isinstance(content, Mapping):
        keys = ("state_dict", "model_avg", "model")
        states = [content[key] for key in keys if key in content]
    tensors = tensors_of((states or [content])[0])
    if not tensors:
        raise ModelError(f"{path}: no state_dict of tensors inside; is it an MLD checkpoint?")
    return tensors


def tensors_of(state: Any) -> dict[str, Tensor]:
    """Returns the tensors of a dictionary by name; none for anything else.

    Raises:
        ModelError: One is sparse, ragged, quantized, empty or larger than what is stored of it.
    """
    items = state.items() if isinstance(state, Mapping) else ()
    tensors = {str(name): value for name, value in items if isinstance(value, Tensor)}
    for name, tensor in tensors.items():
        usual = tensor.layout == torch.strided and not tensor.is_nested and not tensor.is_quantized
        if not usual or tensor.device.type != "cpu" or tensor.dtype not in _STORAGES.values():
            raise ModelError(f"{name} is sparse, ragged or quantized, expected a plain tensor")
        if not 0 < tensor.nbytes <= tensor.untyped_storage().nbytes():
            shape = tuple(tensor.shape)
            raise ModelError(f"{name} of shape {shape} has no numbers of its own in the file")
    stored = {
        t.untyped_storage().data_ptr(): t.untyped_storage().nbytes() for t in tensors.values()
    }
    if sum(tensor.nbytes for tensor in tensors.values()) > _MOST_SHARED * sum(stored.values()):
        raise ModelError("its tensors share the same numbers too often")
    return tensors


def split_parts(state: Mapping[str, Tensor]) -> tuple[dict[str, dict[str, Tensor]], dict[str, int]]:
    """Returns the tensors of each of `PARTS` without that prefix, and the number of others."""
    parts = {
        part: {
            name.removeprefix(f"{part}."): tensor.float()
            for name, tensor in state.items()
            if name.startswith(f"{part}.")
        }
        for part in PARTS
    }
    others = Counter(head for head in (name.split(".")[0] for name in state) if head not in PARTS)
    return parts, dict(others)


# Endings of PyTorch's files that motions have, too.
_SHARED = {".pkl", ".pt"}


def read_content(path: Path) -> Any:
    """Returns the content of a PyTorch file without running code.

    Raises:
        ModelError: The file is missing, damaged, of another kind, or holds code.
    """
    if not path.exists():
        raise ModelError(f"{path} does not exist")
    if path.suffix.lower() in formats.READABLE.keys() - _SHARED:
        raise ModelError(
            f"{path} is a motion file, expected a checkpoint such as mld.ckpt; to write the motion "
            f"in another format: latentmotion clean {path} -o motion.bvh"
        )
    try:
        if is_zipfile(path):
            return read_with_placeholders(path)
        _check_old(path)
        with warnings.catch_warnings(action="ignore"):
            return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        first_line = (str(error).strip().splitlines() or [""])[0]
        raise ModelError(
            f"{path} is damaged, or holds more than tensors and was not opened, because that could "
            f"run code ({first_line}). If you trust the file, keep its weights alone: python -c "
            f"\"import torch; torch.save({{'state_dict': torch.load('{path}', map_location='cpu', "
            "weights_only=False)['state_dict']}, 'weights.ckpt')\""
        ) from error
    except Exception as error:  # a damaged file fails anywhere inside zip, pickle or torch
        raise ModelError(
            f"{path} is no PyTorch checkpoint, or is damaged ({type(error).__name__}: "
            f"{error!s:.200}); download it again"
        ) from error


def _check_old(path: Path) -> None:
    """Checks what a file of PyTorch before 1.6, which is no zip, names in its four pickles.

    Raises:
        UnpicklingError: It names something unknown, or is no pickle.
    """
    allowed = _TensorUnpickler(io.BytesIO(), None, "").allowed
    with path.open("rb") as file:
        operations = (operation for _ in range(4) for operation in pickletools.genops(file))
        for opcode, argument, _ in operations:
            if opcode.name == "STACK_GLOBAL" or opcode.name.startswith("EXT"):
                raise pickles.ForbiddenName(f"something by {opcode.name}")
            if opcode.name not in ("GLOBAL", "INST"):
                continue
            module, _, name = str(argument).partition(" ")
            module = pickles.PYTHON_2.get(module, module)
            try:
                kind = allowed(module, name)
            except KeyError as error:
                raise pickles.ForbiddenName(f"{module}.{name}") from error
            if kind is Placeholder and name not in _OLD:
                raise pickles.ForbiddenName(f"{module}.{name}")


# Placeholders whose own functions PyTorch calls in old files, with no sizes to choose.
_OLD = ("Size", "dtype", "scalar", "encode", "defaultdict", "set", "dict", "list")


class Placeholder:
    """Accepts whatever a pickle does to an object, and keeps none of it."""

    def __new__(cls, *_: Any, **__: Any) -> Placeholder:
        """Ignores all arguments."""
        return super().__new__(cls)

    def __call__(self, *_: Any) -> Placeholder:
        """Ignores all arguments."""
        return self

    __setstate__ = __setitem__ = append = extend = add = __call__


def read_with_placeholders(path: Path) -> Any:
    """Returns the tensors and plain values of a PyTorch file, and placeholders for all else.

    Raises:
        ForbiddenName: It names something unknown.
        Exception: The file is damaged, or no zip file.
    """
    with ZipFile(path) as archive:
        array_files.check_members(path, archive.infolist())
        names = [name for name in archive.namelist() if name.endswith("/data.pkl")]
        file = io.BytesIO(archive.read(names[0]))
        return _TensorUnpickler(file, archive, names[0].removesuffix(".pkl")).load()


class _TensorUnpickler(pickles.RestrictedUnpickler):
    """Reads the tensors of a PyTorch file beside plain values."""

    def __init__(self, file: Any, archive: ZipFile | None, folder: str) -> None:
        super().__init__(file, self.allowed, encoding="utf-8")
        self._archive, self._folder = archive, folder
        self._storages: dict[tuple[str, torch.dtype], Tensor] = {}

    def allowed(self, module: str, name: str) -> Any:
        """Returns what a pickle gets for a name; raises KeyError for names that it must not use."""
        if module == "torch" and name in _STORAGES:
            return _STORAGES[name]
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _rebuilt
        if (module, name) == ("torch._utils", "_rebuild_parameter"):
            return lambda tensor, *_: tensor
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        full = f"{module}.{name}"
        if full in KNOWN or full.startswith(KNOWN_PACKAGES):
            return Placeholder
        raise KeyError(full)

    def persistent_load(self, pid: Any) -> Tensor:
        _, dtype, key, _, count = pid
        if count == 0:
            return torch.empty(0, dtype=dtype)
        if (key, dtype) not in self._storages:
            assert self._archive is not None
            content = bytearray(self._archive.read(f"{self._folder}/{int(key)}"))
            self._storages[key, dtype] = torch.frombuffer(content, dtype=dtype, count=count)
        return self._storages[key, dtype]


def _rebuilt(storage: Tensor, offset: int, size: Any, stride: Any, *_: Any) -> Tensor:
    """Returns a tensor of a storage; raises ValueError for one that repeats its numbers."""
    if math.prod(size) > storage.numel():
        raise ValueError(f"a tensor of shape {tuple(size)} of {storage.numel()} stored numbers")
    return storage.as_strided(size, stride, offset)


Weights = dict[str, Tensor]
Rules = tuple[tuple[str, str], ...]

# Patterns of the authors' names and what takes their place, by network.
_NAMES: dict[str, Rules] = {
    network: tuple(names.items())
    for network, names in packaged_toml(__file__, "names.toml").items()
}


def rules_of(*networks: str) -> Rules:
    """Returns the rules of some parts of the table, in order."""
    return tuple(rule for network in networks for rule in _NAMES[network])


def rename(weights: Mapping[str, Tensor], rules: Rules) -> Weights:
    """Returns the weights of one network under this project's names and in its shapes.

    Raises:
        ModelError: A stored sine table differs from the formula.
    """
    weights = dict(weights)
    if "encoder.mu_token" in weights and "encoder.logvar_token" in weights:
        tokens = [weights.pop("encoder.mu_token"), weights.pop("encoder.logvar_token")]
        weights["summary"] = torch.stack(tokens)
    renamed: Weights = {}
    for name, tensor in weights.items():
        if name.endswith(("multihead_attn.in_proj_weight", "multihead_attn.in_proj_bias")):
            stem, kind = _rename(name, rules, {}).split("multihead_attn.in_proj_")
            width = tensor.shape[0] // 3
            renamed[f"{stem}cross_attention.query.{kind}"] = tensor[:width]
            renamed[f"{stem}cross_attention.key_value.{kind}"] = tensor[width:]
            continue
        reshaped = tensor.squeeze(1) if name.endswith(".pe") else tensor
        reshaped = reshaped.T if name.endswith("action_embedding") else reshaped
        renamed[_rename(name, rules, weights)] = reshaped
    for name, table in list(renamed.items()):
        if not name.endswith(".table") or table.shape[0] <= LEARNED_LENGTH:
            continue
        length, width = table.shape
        if not torch.allclose(table, sines(torch.arange(length), sine_rate(width)), atol=1e-3):
            raise ModelError(f"the fixed positions {name!r} are not the sine table of ACTOR")
        del renamed[name]
    return renamed


def _rename(name: str, rules: Rules, weights: Mapping[str, Tensor]) -> str:
    # The second norm of a layer follows cross-attention if there is a third.
    has_third = re.sub(r"\bnorm2\..*", "norm3.weight", name) in weights
    second = "around_cross_attention" if has_third else "around_feed_forward"
    for pattern, replacement in (*rules, *_NAMES["layers"], (r"\bnorm2\.", f"{second}.norm.")):
        name = re.sub(pattern, replacement, name)
    return name
