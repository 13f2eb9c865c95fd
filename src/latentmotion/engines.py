"""Engines that run ONNX graphs without PyTorch; every graph of the package is opened here.

Both use at most as many threads as they are told, and none that spins while it waits.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from latentmotion.errors import InputError


def most_threads(threads: int | None) -> int:
    """Returns how many threads a graph may use; where nothing is said, one per core.

    Raises:
        InputError: A number below 1.
    """
    if threads is not None and threads < 1:
        raise InputError(f"{threads} threads: expected 1 or more")
    return threads or _available_cores()


def onnxruntime_session(path: Path, threads: int, optimized: Path | None = None) -> Any:
    """Returns ONNX Runtime's session of a graph, which it may write as it runs it: `optimized`."""
    # ONNX Runtime (seen in 1.31) starts telemetry as it is imported, unless told not to before.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # Threads that spin while idle make times bimodal on shared cores.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    # Its further fusions make transformers slower (by 6 % alone, 18 % in batches) and load later.
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    if optimized is not None:
        options.optimized_model_filepath = str(optimized)
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def openvino_model(path: Path, threads: int) -> Any:
    """Returns OpenVINO's compiled model of a graph on the CPU."""
    # As it is imported, OpenVINO (seen in 2026.4) reports to Google, unless this package is absent.
    sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]
    import openvino

    # Left alone, OpenVINO may compute in bfloat16 and change the result.
    settings: dict[str, Any] = {
        "INFERENCE_PRECISION_HINT": "f32",
        "INFERENCE_NUM_THREADS": threads,
        "PERFORMANCE_HINT": "LATENCY",
    }
    return openvino.Core().compile_model(path, "CPU", settings)


def _available_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
