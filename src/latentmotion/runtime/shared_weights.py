"""One copy of the weights: graphs read theirs from the model's `weights.safetensors`.

An initializer that equals a tensor of that file, as it is or transposed, becomes external data of
ONNX (file, offset, length): 16 bits, which the engine casts to 32 while it loads. What the network
is was rounded to 16 bits before, so nothing is lost; what is not in the file stays in the graph.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import NodeProto, TensorProto, helper, numpy_helper

from latentmotion.storage.files import atomic_file

FEWEST = 256
"""Numbers of a tensor that is worth a reference."""

_HEADER_LENGTH = 8  # a safetensors file begins with the length of its JSON header


@dataclass(frozen=True)
class Place:
    """Where 16-bit numbers lie in a file."""

    shape: tuple[int, ...]
    """Shape there."""
    offset: int
    """Their first byte."""
    length: int
    """Bytes."""
    turned: bool
    """Whether the graph has the transpose."""


def share_weights(graph: Path, weights: Path) -> None:
    """Rewrites a graph so that its weights are read from a file in the same folder.

    Args:
        graph: The `.onnx` file.
        weights: The `.safetensors` file beside it, which has to stay there.
    """
    model = onnx.load(graph, load_external_data=False)
    places = _places(weights)
    kept: list[TensorProto] = []
    casts: list[NodeProto] = []
    for tensor in model.graph.initializer:
        whole = tensor.data_type == TensorProto.FLOAT
        place = places.get(_key(numpy_helper.to_array(tensor))) if whole else None
        kept.append(_reference(tensor.name, place, weights.name) if place else tensor)
        casts.extend(_reading(tensor.name, place) if place else [])
    _replace(model.graph.initializer, kept)
    _replace(model.graph.node, [*casts, *model.graph.node])
    with atomic_file(graph) as temporary:
        temporary.write_bytes(model.SerializeToString())


def _places(weights: Path) -> dict[tuple[tuple[int, ...], bytes], Place]:
    """Every 16-bit tensor of a file, and its transpose, by shape and numbers."""
    content = weights.read_bytes()
    start = _HEADER_LENGTH + int.from_bytes(content[:_HEADER_LENGTH], "little")
    found = {}
    for name, entry in json.loads(content[_HEADER_LENGTH:start]).items():
        if name == "__metadata__" or entry["dtype"] != "F16":
            continue
        first, last = (start + offset for offset in entry["data_offsets"])
        array = np.frombuffer(content[first:last], np.float16).reshape(entry["shape"])
        if array.size < FEWEST:
            continue
        for seen, turned in ((array.T, True), (array, False)):
            found[_key(seen)] = Place(array.shape, first, last - first, turned)
    return found


def _key(array: np.ndarray) -> tuple[tuple[int, ...], bytes]:
    return array.shape, np.ascontiguousarray(array, np.float32).tobytes()


def _reference(name: str, place: Place, file: str) -> TensorProto:
    tensor = TensorProto(name=f"{name}.half", data_type=TensorProto.FLOAT16, dims=place.shape)
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in (("location", file), ("offset", place.offset), ("length", place.length)):
        tensor.external_data.add(key=key, value=str(value))
    return tensor


def _reading(name: str, place: Place) -> list[NodeProto]:
    """Nodes that make of 16 bits what the graph had; engines run them once, while loading."""
    whole = f"{name}.whole" if place.turned else name
    cast = helper.make_node("Cast", [f"{name}.half"], [whole], to=TensorProto.FLOAT)
    return [cast, helper.make_node("Transpose", [whole], [name])] if place.turned else [cast]


def _replace(field: Any, values: Sequence[NodeProto | TensorProto]) -> None:
    """Puts values into a repeated field of a message; some of them may be in it now."""
    copies: list[Any] = []
    for value in values:
        copies.append(type(value)())
        copies[-1].CopyFrom(value)
    del field[:]
    field.extend(copies)
