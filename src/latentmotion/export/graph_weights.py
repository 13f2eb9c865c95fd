"""Weights of graphs: read from the model's `weights.safetensors`, or kept in 8 bits.

An initializer that equals a tensor of that file, as it is or transposed, becomes external data of
ONNX (file, offset, length): 16 bits, or 8 with a scale for each row, which the engine makes 32
while it loads. The network was rounded before, so nothing is lost. Tensors that are not in the file
stay in the graph.

In graphs of 8 bits 64 weights share a scale, and so do 64 inputs. This is ONNX Runtime's
MatMulNBits, which OpenVINO reads, too. Dynamic quantization has one scale for all inputs, so that a
motion would depend on its batch. Convolutions stay in float32: in 8 bits they took three times as
long (lab/diary/runtime.md).
"""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnx
from onnx import NodeProto, TensorProto, helper, numpy_helper

from latentmotion.engine.session import onnxruntime_session
from latentmotion.networks.checkpoint import SCALE
from latentmotion.storage.files import atomic_file

Weights = Literal["int8", "float16"]
"""Storage of large matrices: 8 bits with a scale for each row, or 16 bits."""

FEWEST = 256
"""Minimum size of a tensor that is worth a reference."""

BLOCK = 64
"""Numbers that share a scale."""

# MatMulNBits' name for products of integers.
_EIGHT_BIT_INPUTS = 4

# Types of numbers as safetensors files name them, in NumPy and in ONNX.
_TYPES = {
    "F16": (np.float16, TensorProto.FLOAT16),
    "F32": (np.float32, TensorProto.FLOAT),
    "I8": (np.int8, TensorProto.INT8),
}

_HEADER_LENGTH = 8  # a safetensors file begins with the length of its JSON header


@dataclass(frozen=True)
class StoredTensor:
    """A tensor in a file, whole or a matrix in 8 bits with a scale for each row."""

    kind: int
    """ONNX's type of its numbers."""
    shape: tuple[int, ...]
    """Its shape in the file."""
    offset: int
    """Position of its first byte."""
    length: int
    """Number of bytes."""
    scale: StoredTensor | None = None
    """Scales of the rows of a matrix in 8 bits."""
    transposed: bool = False
    """Whether the graph has the transpose."""

    def external(self, name: str, file: str) -> TensorProto:
        """Returns the initializer that a graph reads from that file."""
        tensor = TensorProto(name=name, data_type=self.kind, dims=self.shape)
        tensor.data_location = TensorProto.EXTERNAL
        where = {"location": file, "offset": self.offset, "length": self.length}
        for field, value in where.items():
            tensor.external_data.add(key=field, value=str(value))
        return tensor


def share_weights(graph: Path, weights: Path) -> None:
    """Rewrites a graph so that its weights are read from a file in the same folder.

    Args:
        graph: The `.onnx` file.
        weights: The `.safetensors` file beside it, which has to stay there.
    """
    model = onnx.load(graph, load_external_data=False)
    stored = stored_tensors(weights)
    initializers: list[TensorProto] = []
    nodes: list[NodeProto] = []
    for tensor in model.graph.initializer:
        inside = tensor.data_location != TensorProto.EXTERNAL
        float32 = inside and tensor.data_type == TensorProto.FLOAT
        shared = stored.get(_key(numpy_helper.to_array(tensor))) if float32 else None
        if shared is None:
            initializers.append(tensor)
            continue
        name, stored_as, file = tensor.name, f"{tensor.name}.stored", weights.name
        initializers.append(shared.external(stored_as, file))
        # Nodes that restore the graph's tensor; engines run them once, while loading.
        whole = f"{name}.whole" if shared.transposed else name
        if shared.scale is None:
            nodes.append(helper.make_node("Cast", [stored_as], [whole], to=TensorProto.FLOAT))
        else:
            initializers.append(shared.scale.external(f"{name}.scale", file))
            nodes += scaled_rows(stored_as, f"{name}.scale", whole)
        if shared.transposed:
            nodes.append(helper.make_node("Transpose", [whole], [name]))
    _replace(model.graph.initializer, initializers)
    _replace(model.graph.node, [*nodes, *model.graph.node])
    with atomic_file(graph) as temporary:
        temporary.write_bytes(model.SerializeToString())


def scaled_rows(packed: str, scale: str, matrix: str) -> list[NodeProto]:
    """Returns nodes that make a matrix of its numbers in 8 bits and a scale for each row."""
    return [
        helper.make_node("Cast", [packed], [f"{packed}.float"], to=TensorProto.FLOAT),
        helper.make_node("Mul", [f"{packed}.float", scale], [matrix]),
    ]


def stored_tensors(weights: Path) -> dict[tuple[tuple[int, ...], bytes], StoredTensor]:
    """Returns every tensor of a file in 16 or 8 bits, and its transpose, by shape and numbers."""
    content = weights.read_bytes()
    start = _HEADER_LENGTH + int.from_bytes(content[:_HEADER_LENGTH], "little")
    entries = json.loads(content[_HEADER_LENGTH:start])

    def read(name: str) -> tuple[StoredTensor, np.ndarray]:
        first, last = (start + offset for offset in entries[name]["data_offsets"])
        dtype, kind = _TYPES[entries[name]["dtype"]]
        array = np.frombuffer(content[first:last], dtype).reshape(entries[name]["shape"])
        return StoredTensor(kind, array.shape, first, last - first), array

    stored = {}
    for name, entry in entries.items():
        if name == "__metadata__" or entry["dtype"] not in ("F16", "I8"):
            continue
        tensor, array = read(name)
        if array.size < FEWEST:
            continue
        if name + SCALE in entries:
            scale, factors = read(name + SCALE)
            tensor, array = replace(tensor, scale=scale), array * factors
        for values, transposed in ((array.T, True), (array, False)):
            stored[_key(values)] = replace(tensor, transposed=transposed)
    return stored


def _key(array: np.ndarray) -> tuple[tuple[int, ...], bytes]:
    return array.shape, np.ascontiguousarray(array, np.float32).tobytes()


def _replace(field: Any, values: Sequence[NodeProto | TensorProto]) -> None:
    """Puts values into a repeated field of a message; some of them may be in it now."""
    copies: list[Any] = []
    for value in values:
        copies.append(type(value)())
        copies[-1].CopyFrom(value)
    del field[:]
    field.extend(copies)


def quantize(graph: Path) -> None:
    """Rewrites a graph with its matrix products in 8 bits."""
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    from onnxruntime.quantization.matmul_nbits_quantizer import MatMulNBitsQuantizer

    # While it is imported, that module sets up logging for the whole program.
    root.handlers[:], root.level = handlers, level
    # ONNX Runtime computes constants as it loads a graph; so every weight becomes a matrix.
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "folded.onnx"
        onnxruntime_session(graph, 1, optimized=written)
        model = onnx.load(written)
    card = {entry.key: entry.value for entry in onnx.load(graph).metadata_props}
    onnx.helper.set_model_props(model, card)
    quantizer = MatMulNBitsQuantizer(
        model,
        bits=8,
        block_size=BLOCK,
        is_symmetric=True,
        accuracy_level=_EIGHT_BIT_INPUTS,
    )
    quantizer.process()
    with atomic_file(graph) as temporary:
        onnx.save(quantizer.model.model, temporary)  # pyright: ignore[reportAttributeAccessIssue]
