"""A network becomes an ONNX graph: named inputs, free axes, and no trace of who made it."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import onnx
import torch
from onnx import GraphProto, ModelProto
from torch import Tensor, nn
from torch.export import Dim

from latentmotion.storage.files import atomic_file


def trace(
    network: nn.Module,
    inputs: Mapping[str, Tensor],
    free: Mapping[str, Sequence[int]],
    path: Path,
    outputs: Sequence[str] = (),
    card: Mapping[str, str] | None = None,
) -> None:
    """Writes the graph of a network.

    Args:
        network: What is traced, in `eval()` mode.
        inputs: An example of each input, by the name of the network's argument.
        free: Axes of each input that may be of any length.
        path: The `.onnx` file.
        outputs: Names of the outputs; by default the exporter's.
        card: What the graph says of itself.
    """
    axes = {name: dict.fromkeys(free[name], Dim.DYNAMIC) for name in inputs}
    with warnings.catch_warnings():
        # The exporter warns of its own internals; what it wrote is compared with eager in tests.
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program = torch.onnx.export(
            network.eval(),
            kwargs=dict(inputs),
            input_names=list(inputs),
            output_names=list(outputs) or None,
            dynamic_shapes=axes,
            dynamo=True,
            verbose=False,
        )
    assert program is not None  # as dynamo is asked for
    graph = anonymous(program.model_proto)
    onnx.helper.set_model_props(graph, dict(card or {}))
    with atomic_file(path) as temporary:
        onnx.save(graph, temporary)


def anonymous(model: ModelProto) -> ModelProto:
    """Returns a graph without the exporter's notes: source paths, stack traces, class names."""
    clean = ModelProto()
    clean.CopyFrom(model)
    for graph in (clean.graph, *clean.functions):
        _strip(graph)
    return clean


def _strip(graph: GraphProto | onnx.FunctionProto) -> None:
    values = [*graph.value_info, *getattr(graph, "input", []), *getattr(graph, "output", [])]
    kept = getattr(graph, "initializer", [])
    for part in (graph, *graph.node, *kept, *(v for v in values if not isinstance(v, str))):
        part.ClearField("metadata_props")
        part.ClearField("doc_string")
