"""A network without PyTorch: one ONNX graph on ONNX Runtime or on OpenVINO, arrays in and out."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np

from latentmotion.errors import InputError, MissingExtraError, ModelError
from latentmotion.model_card import ModelCard

Runtime = Literal["auto", "onnxruntime", "openvino"]
"""Which engine runs the graphs; `auto` takes OpenVINO where it is installed."""

Session = Callable[..., np.ndarray]
"""A loaded graph: called with its inputs by name, returns its first output."""


def open_session(path: Path, runtime: Runtime = "auto", threads: int | None = None) -> Session:
    """Loads an ONNX graph.

    Args:
        path: The `.onnx` file.
        runtime: The engine.
        threads: Most threads it may use; by default the cores this process may run on.

    Raises:
        InputError: A number of threads below 1.
        MissingExtraError: OpenVINO was asked for and is not installed.
        ModelError: The file is missing or damaged.
    """
    if not path.is_file():
        raise ModelError(f"{path} is missing; a model folder needs it: export or download it again")
    if threads is not None and threads < 1:
        raise InputError(f"{threads} threads: expected 1 or more")
    limit = threads or _available_cores()
    try:
        return _ENGINES[_chosen(runtime)](path, limit)
    except (InputError, MissingExtraError):
        raise
    except Exception as error:  # each engine has error classes of its own
        raise ModelError(
            f"{path} cannot be loaded, it is damaged or no ONNX graph; copy the folder again"
        ) from error


def open_decoder(
    card: ModelCard, folder: Path, runtime: Runtime = "auto", threads: int | None = None
) -> Session:
    """Loads the decoder of a model folder; without a VAE the latents are the features already.

    Raises:
        MissingExtraError: OpenVINO was asked for and is not installed.
        ModelError: The file is missing or damaged.
    """
    if not has_decoder(card):
        return raw_frames
    return open_session(folder / "decoder.onnx", runtime, threads)


def has_decoder(card: ModelCard) -> bool:
    """Returns whether there is a VAE with weights, or the diffusion is on raw frames."""
    return card.vae.get("kind", "none") not in ("none", "IdentityVAEConfig")


def raw_frames(latents: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Returns latents that are normalized features already, zero on padding."""
    return latents * mask[..., None]


def _chosen(runtime: Runtime) -> str:
    installed = find_spec("openvino") is not None
    if runtime == "auto":
        return "openvino" if installed else "onnxruntime"
    if runtime not in _ENGINES:
        raise InputError(f"unknown runtime {runtime!r}; known are auto, {', '.join(_ENGINES)}")
    if runtime == "openvino" and not installed:
        raise MissingExtraError("the runtime openvino", "openvino", "fast")
    return runtime


def _available_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _open_onnxruntime(path: Path, threads: int) -> Session:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # Threads that spin while idle make times bimodal on shared cores.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])

    def run(**inputs: np.ndarray) -> np.ndarray:
        return np.asarray(session.run(None, inputs)[0])

    return run


def _open_openvino(path: Path, threads: int) -> Session:
    import openvino

    # Left alone, OpenVINO may compute in bfloat16 and change the result.
    settings: dict[str, Any] = {
        "INFERENCE_PRECISION_HINT": "f32",
        "INFERENCE_NUM_THREADS": threads,
        "PERFORMANCE_HINT": "LATENCY",
    }
    model = openvino.Core().compile_model(path, "CPU", settings)

    def run(**inputs: np.ndarray) -> np.ndarray:
        # A request of its own for each call keeps sessions safe to share between threads.
        return np.array(model.create_infer_request().infer(inputs)[0])

    return run


_ENGINES: dict[str, Callable[[Path, int], Session]] = {
    "onnxruntime": _open_onnxruntime,
    "openvino": _open_openvino,
}
