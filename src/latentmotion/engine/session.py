"""Sessions: networks without PyTorch, each an ONNX graph on ONNX Runtime or OpenVINO.

Every graph of the package is opened here. Engines use at most the given number of threads, and
none that spins while it waits.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import find_spec
from mmap import ACCESS_READ, mmap
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from latentmotion.errors import InputError, MissingExtraError, ModelError
from latentmotion.model.card import ModelCard
from latentmotion.storage.limits import GRAPH_MEMORY

# Engine of the graphs; `auto` takes ONNX Runtime, as fast as OpenVINO and sooner loaded.
Runtime = Literal["auto", "onnxruntime", "openvino"]

# A loaded graph: called with its inputs by name, returns its first output.
Session = Callable[..., np.ndarray]


def open_session(path: Path, runtime: Runtime = "auto", threads: int | None = None) -> Session:
    """Loads an ONNX graph.

    Args:
        path: The `.onnx` file.
        runtime: The engine.
        threads: Maximum number of threads; by default the cores that this process may run on.

    Raises:
        InputError: The number of threads is below 1.
        MissingExtraError: OpenVINO is requested and not installed.
        ModelError: The file is missing or damaged, or holds a loop.
    """
    engine, limit = _ENGINES[_checked(path, runtime)], thread_limit(threads)
    try:
        infer = engine(path, limit)
    except ModelError:
        raise
    except Exception as error:  # each engine has error classes of its own
        raise ModelError(
            f"{path} cannot be loaded, it is damaged or no ONNX graph; copy the folder again"
        ) from error

    def run(**inputs: np.ndarray) -> np.ndarray:
        try:
            return infer(inputs)
        except Exception as error:  # the same
            shapes = ", ".join(f"{name} {np.shape(array)}" for name, array in inputs.items())
            raise ModelError(
                f"{path} cannot take {shapes}, which the model's card says ({error!s:.200}): the "
                "graph is of another model; copy or export the folder again"
            ) from error

    return run


class PickledByFields:
    """A dataclass whose pickles and copies have its fields, not what it has loaded since."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: vars(self)[name] for name in self.__dataclass_fields__}  # type: ignore[attr-defined]


@dataclass(frozen=True)
class LazySession(PickledByFields):
    """A graph that is loaded when it is first called, so that unused graphs cost nothing.

    Raises:
        InputError: The number of threads is below 1.
        MissingExtraError: OpenVINO is requested and not installed.
        ModelError: The file is missing; when called, also that it is damaged.
    """

    path: Path  # The `.onnx` file.
    runtime: Runtime = "auto"  # The engine.
    # Maximum number of threads; by default the cores that this process may run on.
    threads: int | None = None

    def __post_init__(self) -> None:
        _checked(self.path, self.runtime)
        thread_limit(self.threads)

    def __call__(self, **inputs: np.ndarray) -> np.ndarray:
        """Returns the graph's first output."""
        return self._session(**inputs)

    @cached_property
    def _session(self) -> Session:
        return open_session(self.path, self.runtime, self.threads)


def fused_sampler_file(steps: int) -> str:
    """Returns the name of a fused sampler's graph in a model folder."""
    return f"fused_{steps}.onnx"


PULLBACK_FILE = "pullback.onnx"


def open_decoder(
    card: ModelCard, folder: Path, runtime: Runtime = "auto", threads: int | None = None
) -> Session:
    """Returns the decoder of a model folder; without a VAE the latents are the features already.

    Raises:
        MissingExtraError: OpenVINO is requested and not installed.
        ModelError: The file is missing.
    """
    if not card.vae.has_weights:
        return lambda latents, mask: latents * mask[..., None]  # zero on padding
    return LazySession(folder / "decoder.onnx", runtime, threads)


def thread_limit(threads: int | None) -> int:
    """Returns the maximum number of threads of a graph: the given one, else one per core.

    Raises:
        InputError: The number is below 1.
    """
    if threads is not None and threads < 1:
        raise InputError(f"{threads} threads: expected 1 or more")
    if threads is not None:
        return threads
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def onnxruntime_session(path: Path, threads: int, optimized: Path | None = None) -> Any:
    """Returns ONNX Runtime's own session of a graph.

    Args:
        path: The `.onnx` file.
        threads: Maximum number of threads.
        optimized: File to which ONNX Runtime writes the graph as it runs it, if any.

    Raises:
        ModelError: It holds a loop, or cannot be read.
    """
    check_graph(path)
    # ONNX Runtime (seen in 1.31) starts telemetry when imported, unless this is set before.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # Threads that spin while idle make times bimodal on shared cores.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    _limit_memory()
    options.add_session_config_entry("session.use_env_allocators", "1")
    # Its further fusions make transformers slower (by 6 % alone, 18 % in batches) and load later.
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    if optimized is not None:
        options.optimized_model_filepath = str(optimized)
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def check_graph(path: Path) -> None:
    """Checks that a graph ends: nodes that repeat others may do so forever.

    Raises:
        ModelError: It has such a node, or cannot be read.
    """
    try:
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
            repeating = [match[1].decode() for match in _REPEATING.finditer(content)]
    except (OSError, ValueError) as error:  # ValueError: an empty file
        raise ModelError(f"{path} cannot be read: {error}; copy the folder again") from error
    if repeating:
        raise ModelError(
            f"{path} has a node {repeating[0]}, which may repeat others forever; graphs of "
            "this package have none"
        )


# Kinds of nodes behind their length, in any spelling that protobuf has for it.
_REPEATING = re.compile(rb"(?:\x04|\x84\x80*\x00|\x0b|\x8b\x80*\x00)(Loop|Scan|SequenceMap)")


@cache
def _limit_memory() -> None:
    """Limits what all graphs of this process take: one of a few bytes may ask for any amount."""
    import onnxruntime

    arena = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR
    memory = onnxruntime.OrtMemoryInfo("Cpu", arena, 0, onnxruntime.OrtMemType.DEFAULT)
    settings = onnxruntime.OrtArenaCfg(GRAPH_MEMORY, -1, -1, -1)
    onnxruntime.create_and_register_allocator(memory, settings)


def _checked(path: Path, runtime: Runtime) -> str:
    """Checks that the file exists and the engine is installed; returns the engine's name."""
    if not path.is_file():
        raise ModelError(f"{path} is missing; a model folder needs it: export or download it again")
    if runtime == "auto":
        return "onnxruntime"
    if runtime not in _ENGINES:
        raise InputError(f"unknown runtime {runtime!r}; known are auto, {', '.join(_ENGINES)}")
    if runtime == "openvino" and find_spec("openvino") is None:
        raise MissingExtraError("the runtime openvino", "openvino", "fast")
    return runtime


# A graph on an engine: its inputs by name to its first output.
Inference = Callable[[Mapping[str, np.ndarray]], np.ndarray]


def _on_onnxruntime(path: Path, threads: int) -> Inference:
    session = onnxruntime_session(path, threads)
    return lambda inputs: np.asarray(session.run(None, inputs)[0])


def _on_openvino(path: Path, threads: int) -> Inference:
    # When imported, OpenVINO (seen in 2026.4) reports to Google, unless this package is absent.
    sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]
    import openvino

    # Left alone, OpenVINO may compute in bfloat16, or round what meets weights of 8 bits.
    settings: dict[str, Any] = {
        "INFERENCE_PRECISION_HINT": "f32",
        "DYNAMIC_QUANTIZATION_GROUP_SIZE": 0,
        "INFERENCE_NUM_THREADS": threads,
        "PERFORMANCE_HINT": "LATENCY",
    }
    check_graph(path)
    with _without_links(path) as graph:
        model = openvino.Core().compile_model(graph, "CPU", settings)
    # A request of its own for each call keeps sessions safe to share between threads.
    return lambda inputs: np.array(model.create_infer_request().infer(inputs)[0])


@contextmanager
def _without_links(path: Path) -> Iterator[Path]:
    """Yields a graph beside its weights, as copies where they are links, which OpenVINO refuses.

    The hub's cache is such a folder of links.
    """
    files = [path, *path.parent.glob("*.safetensors")]
    if not any(file.is_symlink() for file in files):
        yield path
        return
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        for file in files:
            shutil.copyfile(file, Path(folder) / file.name)
        yield Path(folder) / path.name


_ENGINES: dict[str, Callable[[Path, int], Inference]] = {
    "onnxruntime": _on_onnxruntime,
    "openvino": _on_openvino,
}
