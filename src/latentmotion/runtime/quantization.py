"""Matrix products in 8 bits: every 64 weights share a scale, and so do every 64 inputs.

That is ONNX Runtime's MatMulNBits, which OpenVINO reads too. Dynamic quantization has one scale for
all inputs, so that a motion would depend on the batch that it is in. Convolutions stay in float32:
in 8 bits they took three times as long (docs/runtime.md).
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import onnx
from onnx import ModelProto

from latentmotion.engines import onnxruntime_session
from latentmotion.storage.files import atomic_file

BLOCK = 64
"""Numbers that share a scale."""

_EIGHT_BIT_INPUTS = 4
"""MatMulNBits' name for products of integers."""


def quantize(graph: Path) -> None:
    """Rewrites a graph with its matrix products in 8 bits."""
    folded = _folded(graph)
    quantizer = _quantizer()(
        folded,
        bits=8,
        block_size=BLOCK,
        is_symmetric=True,
        accuracy_level=_EIGHT_BIT_INPUTS,
    )
    quantizer.process()
    with atomic_file(graph) as temporary:
        onnx.save(quantizer.model.model, temporary)


def _quantizer() -> Callable[..., Any]:
    root = logging.getLogger()
    kept = list(root.handlers), root.level
    from onnxruntime.quantization.matmul_nbits_quantizer import MatMulNBitsQuantizer

    # While it is imported, that module sets up logging for the whole program.
    root.handlers[:], root.level = kept
    return MatMulNBitsQuantizer


def _folded(graph: Path) -> ModelProto:
    """Returns a graph whose constants are computed, so that every weight is a matrix."""
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "folded.onnx"
        onnxruntime_session(graph, 1, optimized=written)
        model = onnx.load(written)
    card = {entry.key: entry.value for entry in onnx.load(graph).metadata_props}
    onnx.helper.set_model_props(model, card)
    return model
