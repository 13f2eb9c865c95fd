"""A network without PyTorch: one ONNX graph on ONNX Runtime or on OpenVINO, arrays in and out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import numpy as np

from latentmotion.engines import most_threads, onnxruntime_session, openvino_model
from latentmotion.errors import InputError, MissingExtraError, ModelError
from latentmotion.model.card import ModelCard

Runtime = Literal["auto", "onnxruntime", "openvino"]
"""Which engine runs the graphs; `auto` takes ONNX Runtime, as fast as OpenVINO, sooner loaded."""

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
    engine, limit = _ENGINES[_checked(path, runtime)], most_threads(threads)
    try:
        return engine(path, limit)
    except Exception as error:  # each engine has error classes of its own
        raise ModelError(
            f"{path} cannot be loaded, it is damaged or no ONNX graph; copy the folder again"
        ) from error


@dataclass(frozen=True)
class OpenedWhenCalled:
    """A graph that is loaded when it is first called: what is not asked for costs nothing.

    Raises:
        InputError: A number of threads below 1.
        MissingExtraError: OpenVINO was asked for and is not installed.
        ModelError: The file is missing; when called, also that it is damaged.
    """

    path: Path
    """The `.onnx` file."""
    runtime: Runtime = "auto"
    """The engine."""
    threads: int | None = None
    """As above."""

    def __post_init__(self) -> None:
        _checked(self.path, self.runtime)
        most_threads(self.threads)

    def __call__(self, **inputs: np.ndarray) -> np.ndarray:
        """Returns the graph's first output."""
        return self._session(**inputs)

    @cached_property
    def _session(self) -> Session:
        return open_session(self.path, self.runtime, self.threads)


def fused_sampler_file(steps: int) -> str:
    """Returns the name of a fused sampler's graph in a model folder."""
    return f"walk_{steps}.onnx"


def open_fused_samplers(
    card: ModelCard, folder: Path, runtime: Runtime = "auto", threads: int | None = None
) -> dict[int, Session]:
    """Finds a model folder's fused samplers, by number of steps.

    Such a graph holds the whole way from noise to features, so that Python and the engine are
    called once instead of once per step: noise, words, words_mask, mask, frames, guidance →
    features in their own units.
    """
    known = card.leaps.steps if card.leaps else ()
    return {
        steps: OpenedWhenCalled(folder / fused_sampler_file(steps), runtime, threads)
        for steps in known
        if (folder / fused_sampler_file(steps)).is_file()
    }


def open_decoder(
    card: ModelCard, folder: Path, runtime: Runtime = "auto", threads: int | None = None
) -> Session:
    """Returns the decoder of a model folder; without a VAE the latents are the features already.

    Raises:
        MissingExtraError: OpenVINO was asked for and is not installed.
        ModelError: The file is missing.
    """
    if not has_decoder(card):
        return raw_frames
    return OpenedWhenCalled(folder / "decoder.onnx", runtime, threads)


def has_decoder(card: ModelCard) -> bool:
    """Returns whether there is a VAE with weights, or the diffusion is on raw frames."""
    return card.vae.has_weights


def raw_frames(latents: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Returns latents that are normalized features already, zero on padding."""
    return latents * mask[..., None]


def _checked(path: Path, runtime: Runtime) -> str:
    """Returns the engine's name, after a look at the file."""
    if not path.is_file():
        raise ModelError(f"{path} is missing; a model folder needs it: export or download it again")
    installed = find_spec("openvino") is not None
    if runtime == "auto":
        return "onnxruntime"
    if runtime not in _ENGINES:
        raise InputError(f"unknown runtime {runtime!r}; known are auto, {', '.join(_ENGINES)}")
    if runtime == "openvino" and not installed:
        raise MissingExtraError("the runtime openvino", "openvino", "fast")
    return runtime


def _on_onnxruntime(path: Path, threads: int) -> Session:
    session = onnxruntime_session(path, threads)

    def run(**inputs: np.ndarray) -> np.ndarray:
        return np.asarray(session.run(None, inputs)[0])

    return run


def _on_openvino(path: Path, threads: int) -> Session:
    model = openvino_model(path, threads)

    def run(**inputs: np.ndarray) -> np.ndarray:
        # A request of its own for each call keeps sessions safe to share between threads.
        return np.array(model.create_infer_request().infer(inputs)[0])

    return run


_ENGINES: dict[str, Callable[[Path, int], Session]] = {
    "onnxruntime": _on_onnxruntime,
    "openvino": _on_openvino,
}
