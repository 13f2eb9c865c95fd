"""Models for the command line: exported ones without PyTorch, all others with it."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from latentmotion.cli.options import AUTO, Runtime
from latentmotion.engines import most_threads
from latentmotion.errors import InputError, MissingExtraError, ModelError
from latentmotion.model.card import read_card
from latentmotion.model.folder import find_model
from latentmotion.pipeline import MotionPipeline
from latentmotion.prior import MotionPrior
from latentmotion.runtime.computing import ON_CPU, Computing, Launch, Precision
from latentmotion.runtime.session import open_decoder


def computing_options(device: str, precision: Precision, launch: Launch) -> Computing:
    """Returns how PyTorch computes; the device `auto` is chosen by `located`, with PyTorch.

    Raises:
        InputError: The options do not go together.
    """
    if device == AUTO and launch == "graph":
        device = "cuda"
    return Computing(device, precision, launch)


def located(computing: Computing) -> Computing:
    """Returns options whose device `auto` is a GPU if there is one, else the CPU."""
    if computing.device != AUTO:
        return computing
    gpu = import_module("torch").cuda.is_available()
    return replace(computing, device="cuda" if gpu else "cpu")


def load_generator(
    model: str | Path,
    runtime: Runtime = "auto",
    threads: int | None = None,
    text_encoder: str | None = None,
    computing: Computing = ON_CPU,
    cache: Path | None = None,
) -> MotionPipeline:
    """Loads a model, exported or not.

    Args:
        model: Name or folder.
        runtime: What runs the networks.
        threads: Most threads of an engine; PyTorch's are set for the whole process.
        text_encoder: Where the folder has none: as for `latentmotion train denoiser`.
        computing: Where and how PyTorch computes, which other engines do not.
        cache: Folder in which embeddings of an exported model's prompts are kept.

    Raises:
        InputError: An engine cannot compute there or so, or with that text encoder.
        ModelError: There is no such model, it is damaged, or it needs PyTorch, which is missing.
    """
    folder = find_model(model)
    card = read_card(folder)
    if not card.denoiser:
        raise ModelError(
            f"{model} has a VAE but no denoiser: sample its prior by --prior, or train the "
            "diffusion: latentmotion train denoiser"
        )
    runtime = _runtime_for(computing, runtime, text_encoder)
    if runtime != "pytorch" and (folder / "denoiser.onnx").is_file():
        return MotionPipeline.from_pretrained(folder, runtime, threads, cache)
    eager = _pytorch(folder, runtime, threads)
    return eager.torch_pipeline(folder, text_encoder and _encoder(text_encoder), located(computing))


def load_prior(
    model: str | Path,
    runtime: Runtime = "auto",
    threads: int | None = None,
    computing: Computing = ON_CPU,
) -> MotionPrior:
    """Loads a model's VAE, exported or not, to sample its prior.

    Raises:
        InputError: An engine cannot compute there or so.
        ModelError: There is no such model, it is damaged, or it needs PyTorch, which is missing.
    """
    folder, runtime = find_model(model), _runtime_for(computing, runtime)
    if runtime != "pytorch" and (folder / "decoder.onnx").is_file():
        card = read_card(folder)
        return MotionPrior(card, open_decoder(card, folder, runtime, threads))
    return _pytorch(folder, runtime, threads).torch_prior(folder, located(computing))


def _runtime_for(
    computing: Computing, runtime: Runtime, text_encoder: str | None = None
) -> Runtime:
    """Returns PyTorch, where nothing else can do what is asked for."""
    plain = computing in (ON_CPU, Computing(AUTO))
    if runtime == "pytorch" or (plain and text_encoder is None):
        return runtime
    if runtime == "auto":
        return "pytorch"
    if text_encoder is not None:
        raise InputError(f"the runtime {runtime} takes no --text-encoder; leave one of them out")
    raise InputError(
        f"the runtime {runtime} computes on the CPU, in float32; for {computing} leave it out"
    )


def _pytorch(folder: Path, runtime: Runtime, threads: int | None) -> ModuleType:
    if find_spec("torch") is None and runtime == "pytorch":
        raise MissingExtraError("the runtime pytorch", "PyTorch", "train")
    if find_spec("torch") is None:
        raise ModelError(
            f"{folder} was not exported, and PyTorch, which could run it as it is, is not "
            "installed; run on the machine that trained it: latentmotion export, or here: "
            'pip install "latentmotion[train]"'
        )
    if runtime != "pytorch":
        print(f"{folder} has no graphs (latentmotion export); PyTorch runs it", file=sys.stderr)
    # Looked up only here, so that exported models run without PyTorch.
    if threads is not None:
        import_module("torch").set_num_threads(most_threads(threads))
    return import_module("latentmotion.runtime.eager")


def _encoder(name: str) -> object:
    return import_module("latentmotion.cli.train").text_encoder_named(name)
