"""Quantization of matrix products to 8 bits: 64 weights share a scale, and so do 64 inputs.

This is ONNX Runtime's MatMulNBits, which OpenVINO reads, too. Dynamic quantization has one scale
for all inputs, so that a motion would depend on its batch. Convolutions stay in float32:
in 8 bits they took three times as long (docs/measurements/runtime.md).
"""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path

import onnx

from latentmotion.engine.session import onnxruntime_session
from latentmotion.storage.files import atomic_file

BLOCK = 64
"""Numbers that share a scale."""

_EIGHT_BIT_INPUTS = 4
"""MatMulNBits' name for products of integers."""


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
