"""Weights of graphs: read from the model's `weights.safetensors`, or kept in 8 bits.

An initializer that equals a tensor of that file, as it is or transposed, becomes external data of
ONNX (file, offset, length): 16 bits, which the engine casts to 32 while it loads. The network was
rounded to 16 bits before, so nothing is lost. Tensors that are not in the file stay in the graph.

In 8 bits 64 weights share a scale, and so do 64 inputs. This is ONNX Runtime's MatMulNBits, which
OpenVINO reads, too. Dynamic quantization has one scale for all inputs, so that a motion would
depend on its batch. Convolutions stay in float32: in 8 bits they took three times as long
(docs/measurements/runtime.md).
"""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import NodeProto, TensorProto, helper, numpy_helper

from latentmotion.engine.session import onnxruntime_session
from latentmotion.storage.files import atomic_file

FEWEST = 256
"""Minimum size of a tensor that is worth a reference."""

BLOCK = 64
"""Numbers that share a scale."""

_EIGHT_BIT_INPUTS = 4
"""MatMulNBits' name for products of integers."""

_HEADER_LENGTH = 8  # a safetensors file begins with the length of its JSON header


@dataclass(frozen=True)
class StoredTensor:
    """A tensor of 16-bit numbers in a file."""

    shape: tuple[int, ...]
    """Its shape in the file."""
    offset: int
    """Position of its first byte."""
    length: int
    """Number of bytes."""
    transposed: bool
    """Whether the graph has the transpose."""


def share_weights(graph: Path, weights: Path) -> None:
    """Rewrites a graph so that its weights are read from a file in the same folder.

    Args:
        graph: The `.onnx` file.
        weights: The `.safetensors` file beside it, which has to stay there.
    """
    model = onnx.load(graph, load_external_data=False)
    stored = stored_tensors(weights)
    kept: list[TensorProto] = []
    casts: list[NodeProto] = []
    for tensor in model.graph.initializer:
        float32 = tensor.data_type == TensorProto.FLOAT
        found = stored.get(_key(numpy_helper.to_array(tensor))) if float32 else None
        if found is None:
            kept.append(tensor)
            continue
        name = tensor.name
        half = TensorProto(name=f"{name}.half", data_type=TensorProto.FLOAT16, dims=found.shape)
        half.data_location = TensorProto.EXTERNAL
        half.external_data.add(key="location", value=weights.name)
        half.external_data.add(key="offset", value=str(found.offset))
        half.external_data.add(key="length", value=str(found.length))
        kept.append(half)
        # Nodes that restore the graph's tensor; engines run them once, while loading.
        whole = f"{name}.whole" if found.transposed else name
        casts.append(helper.make_node("Cast", [f"{name}.half"], [whole], to=TensorProto.FLOAT))
        if found.transposed:
            casts.append(helper.make_node("Transpose", [whole], [name]))
    _replace(model.graph.initializer, kept)
    _replace(model.graph.node, [*casts, *model.graph.node])
    with atomic_file(graph) as temporary:
        temporary.write_bytes(model.SerializeToString())


def stored_tensors(weights: Path) -> dict[tuple[tuple[int, ...], bytes], StoredTensor]:
    """Returns every 16-bit tensor of a file, and its transpose, by shape and numbers."""
    content = weights.read_bytes()
    start = _HEADER_LENGTH + int.from_bytes(content[:_HEADER_LENGTH], "little")
    stored = {}
    for name, entry in json.loads(content[_HEADER_LENGTH:start]).items():
        if name == "__metadata__" or entry["dtype"] != "F16":
            continue
        first, last = (start + offset for offset in entry["data_offsets"])
        array = np.frombuffer(content[first:last], np.float16).reshape(entry["shape"])
        if array.size < FEWEST:
            continue
        for values, transposed in ((array.T, True), (array, False)):
            key = _key(values)
            stored[key] = StoredTensor(array.shape, first, last - first, transposed)
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
