"""Models for every verb: exported ones run by their graphs, all others by PyTorch."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from latentmotion.cli import options
from latentmotion.engine import prior, session
from latentmotion.engine.backend import ON_CPU, ExecutionOptions
from latentmotion.errors import InputError, MissingExtraError, ModelError
from latentmotion.model.card import find_or_download, read_card
from latentmotion.pipeline import MotionPipeline


def located(execution: ExecutionOptions) -> ExecutionOptions:
    """Returns options with the device `auto` replaced by a GPU, if there is one, or the CPU."""
    if execution.device != options.AUTO:
        return execution
    return replace(execution, device=import_module("latentmotion.networks.device").default_device())


def load_generator(
    model: str | Path,
    runtime: options.Runtime = "auto",
    threads: int | None = None,
    text_encoder: str | None = None,
    execution: ExecutionOptions = ON_CPU,
    cache: Path | None = None,
) -> MotionPipeline:
    """Loads a model, exported or not.

    Args:
        model: Name, folder or hub id.
        runtime: Engine of the networks.
        threads: Maximum number of threads; PyTorch's are set for the whole process.
        text_encoder: Text encoder if the folder has none, as for `latentmotion train denoiser`.
        execution: Device, precision and launch mode; only PyTorch has other ones than the CPU's.
        cache: Folder in which embeddings of an exported model's prompts are kept.

    Raises:
        InputError: The engine does not support the execution options or the text encoder.
        ModelError: There is no such model, it is damaged, or it needs PyTorch, which is missing.
    """
    folder = find_or_download(model)
    card = read_card(folder)
    if not card.denoiser:
        raise ModelError(
            f"{model} has a VAE but no denoiser: sample its prior by --prior, or train the "
            "diffusion: latentmotion train denoiser"
        )
    if text_encoder and not card.condition.reads_text:
        raise InputError(f"model {model} reads no sentences; leave --text-encoder out")
    runtime = _runtime_for(execution, runtime, text_encoder)
    if runtime != "pytorch" and (folder / "denoiser.onnx").is_file():
        return MotionPipeline.from_pretrained(folder, runtime, threads, cache)
    backend = _pytorch(folder, runtime, threads)
    encoder = backend.text_encoder_named(text_encoder) if text_encoder else None
    return backend.torch_pipeline(folder, encoder, located(execution))


def load_prior(
    model: str | Path,
    runtime: options.Runtime = "auto",
    threads: int | None = None,
    execution: ExecutionOptions = ON_CPU,
) -> prior.MotionPrior:
    """Loads a model's VAE, exported or not, to sample its prior.

    Raises:
        InputError: The engine does not support the execution options.
        ModelError: There is no such model, it is damaged, or it needs PyTorch, which is missing.
    """
    folder, runtime = find_or_download(model), _runtime_for(execution, runtime)
    if runtime != "pytorch" and (folder / "decoder.onnx").is_file():
        card = read_card(folder)
        return prior.MotionPrior(card, session.open_decoder(card, folder, runtime, threads))
    return _pytorch(folder, runtime, threads).torch_prior(folder, located(execution))


def _runtime_for(
    execution: ExecutionOptions, runtime: options.Runtime, text_encoder: str | None = None
) -> options.Runtime:
    """Returns the runtime, or PyTorch if the options need it."""
    plain = execution in (ON_CPU, ExecutionOptions(options.AUTO))
    if runtime == "pytorch" or (plain and text_encoder is None):
        return runtime
    if runtime == "auto":
        return "pytorch"
    if text_encoder is not None:
        raise InputError(f"the runtime {runtime} takes no --text-encoder; leave one of them out")
    raise InputError(
        f"the runtime {runtime} computes on the CPU, in float32; for {execution} leave it out"
    )


def _pytorch(folder: Path, runtime: options.Runtime, threads: int | None) -> ModuleType:
    """Returns the module of pipelines on PyTorch."""
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
    # Imported only here, so that exported models run without PyTorch.
    if threads is not None:
        import_module("torch").set_num_threads(session.thread_limit(threads))
    return import_module("latentmotion.networks.backend")
