"""Packaging: a trained model as a folder that runs without PyTorch.

The folder has card, weights, graphs and text encoder. Weights are stored in 16 bits, or the
denoiser's matrices in 8, and the graphs are made from the rounded weights, so that both give the
same motions.

Decoder swap: one model's decoder for another model with the same encoder, so the same latents.

A few-step student and a light decoder are trained separately from the same model, and combined
here.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import onnx
import torch
from safetensors.torch import save_file

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.schedule import StepCondition
from latentmotion.engine.session import PULLBACK_FILE, fused_sampler_file, open_session
from latentmotion.errors import InputError, ModelError
from latentmotion.export import onnx as graphs
from latentmotion.export.graph_weights import Weights, quantize, share_weights
from latentmotion.model import card as cards
from latentmotion.model.card import GraphPrecision, ModelCard
from latentmotion.model.readme import readme
from latentmotion.networks import checkpoint
from latentmotion.networks.checkpoint import FirstStageModel
from latentmotion.networks.text_encoder import pack
from latentmotion.networks.vae.interface import fingerprint
from latentmotion.progress import counted
from latentmotion.storage.files import atomic_folder
from latentmotion.text.encoder import load_text_encoder

TOLERANCE: dict[GraphPrecision, float] = {"float32": 1e-4, "int8": 0.1}
"""Largest difference allowed between the outputs of a graph and of its network."""

MOST_FUSED = 4
"""Maximum number of steps of a fused sampler: each step adds to its size."""

WriteTextEncoder = Callable[[Path], None]
"""Writes the files of a text encoder into a folder."""


def package_model(
    source: Path,
    card: ModelCard,
    text_encoder: WriteTextEncoder | None,
    output: Path,
    share_encoder: bool = False,
    weights: Weights = "float16",
) -> None:
    """Writes a folder from which `MotionPipeline.from_pretrained` generates.

    Args:
        source: Folder that training wrote, with the weights of all networks.
        card: The card to write, read from `source` or changed; it states the graphs' precision.
        text_encoder: Writes the text encoder; None for models of actions and unconditional ones.
        output: Folder to write, replaced as a whole.
        share_encoder: Whether to leave out the VAE's encoder if a shipped model has the same.
        weights: Precision of the denoiser's matrices in the file. The VAE stays in 16 bits, since
            other models may have the same one.

    Raises:
        ModelError: A file or network is missing, a graph does not repeat its network, or no
            shipped model has the encoder.
    """
    width = card.trained_denoiser.condition_width
    if card.condition.reads_text and text_encoder is None:
        raise ModelError(f"model {card.name!r} reads sentences; pass its text encoder")
    with atomic_folder(output, cards.CARD_FILE) as folder:
        card.write(folder)
        (folder / cards.README_FILE).write_text(readme(card), encoding="utf-8")
        rounded = {
            key: value.half() if value.is_floating_point() else value
            for key, value in checkpoint.model_weights(source).items()
        }
        left_out = checkpoint.encoder_weights(rounded) if share_encoder else {}
        shared = checkpoint.encoder_hash(left_out) if left_out else ""
        if share_encoder and not (shared and checkpoint.encoder_holder(shared, besides=output)):
            raise ModelError(
                "no shipped model has this VAE's encoder, so it cannot be left out; export without "
                "--share-encoder"
            )
        tensors = {key: value for key, value in rounded.items() if key not in left_out}
        for key in [key for key in tensors if key.startswith("denoiser.")]:
            if weights == "int8" and tensors[key].is_floating_point() and tensors[key].ndim == 2:
                tensors[key], tensors[key + checkpoint.SCALE] = pack(tensors[key].float())
        metadata = {checkpoint.ENCODER_HASH: shared} if left_out else None
        save_file(tensors, folder / checkpoint.WEIGHTS_FILE, metadata)
        if text_encoder is not None:
            text_encoder(folder)
            encoder_width = load_text_encoder(folder).width
            if encoder_width != width:
                raise ModelError(
                    f"the text encoder has {encoder_width} numbers per vector, model {card.name!r} "
                    f"reads {width}; it was trained with "
                    f"{card.condition.text_encoder or 'another'!r}"
                )
        _write_graphs(checkpoint.load_model(folder), folder, with_encoder=not left_out)


def copied(folder: Path) -> WriteTextEncoder:
    """Returns a function that copies a text encoder, and its length model, from another folder.

    Raises:
        ModelError: There is no text encoder in it.
    """
    names = cards.TEXT_GRAPH_FILE, cards.TOKENIZER_FILE
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise ModelError(
            f"{folder} lacks {', '.join(missing)}; make them: latentmotion train text-encoder"
        )

    def write(target: Path) -> None:
        onnx.save(
            graphs.anonymous(onnx.load(folder / cards.TEXT_GRAPH_FILE)),
            target / cards.TEXT_GRAPH_FILE,
        )
        shutil.copyfile(folder / cards.TOKENIZER_FILE, target / cards.TOKENIZER_FILE)
        if (folder / cards.LENGTHS_FILE).is_file():
            shutil.copyfile(folder / cards.LENGTHS_FILE, target / cards.LENGTHS_FILE)

    return write


def _write_graphs(model: checkpoint.LatentModel, folder: Path, with_encoder: bool) -> None:
    card, width = model.card, model.card.trained_denoiser.condition_width
    denoiser, decoder = folder / "denoiser.onnx", folder / "decoder.onnx"
    writers = [partial(graphs.export_denoiser, model.denoiser, card.latents.width, width, denoiser)]
    if card.vae.has_weights:
        per_token = card.latents.frames_per_token
        writers.append(partial(graphs.export_decoder, model.vae, per_token, decoder))
    if card.vae.has_weights and with_encoder:
        features, encoder = len(card.normalizer_mean), folder / cards.ENCODER_FILE
        writers.append(partial(graphs.export_encoder, model.vae, features, encoder))
    if card.vae.decoder_margin() is not None:
        writers.append(partial(graphs.export_pullback, model.vae, folder / PULLBACK_FILE))
    for steps in _fused_steps(card):
        sampler = folder / fused_sampler_file(steps)
        writers.append(partial(graphs.export_fused_sampler, model, steps, sampler))
    for write in counted(writers, "writing graphs"):
        write()
    for graph in counted(sorted(folder.glob("*.onnx")), "sharing weights"):
        if card.precision == "int8" and graph.name != PULLBACK_FILE:  # derivatives stay exact
            quantize(graph)
        if graph.name != cards.TEXT_GRAPH_FILE:  # whose weights are its own
            share_weights(graph, folder / checkpoint.WEIGHTS_FILE)
    _check_graphs(model, folder)


def _fused_steps(card: ModelCard) -> list[int]:
    """Returns the numbers of steps that get a fused sampler."""
    return [steps for steps in card.few_step.steps if steps <= MOST_FUSED] if card.few_step else []


def _check_graphs(model: checkpoint.LatentModel, folder: Path) -> None:
    """Compares each graph with its network on random inputs."""
    card, count = model.card, 3
    tokens, width = card.latents.tokens_of(card.frames[0]), card.latents.width
    words = 1 if card.condition.prompted else 0
    t, frames = torch.full((count,), 0.5), torch.ones(count, card.frames[0], dtype=torch.bool)
    shared = {
        "words_mask": torch.ones(count, words, dtype=torch.bool),
        "mask": torch.ones(count, tokens, dtype=torch.bool),
    }

    def drawn(name: str) -> dict[str, torch.Tensor]:
        latents = torch.randn(count, tokens, width)
        return {name: latents, "words": torch.randn(count, words, shown), **shared}

    shown = card.trained_denoiser.condition_width
    inputs = {**drawn("z"), "t": t}
    further = {"guidance": 3 * t, "step_size": t} if model.denoiser.further_inputs else {}
    condition = Conditioning(inputs["words"], inputs["words_mask"])
    with torch.no_grad():
        expected = model.denoiser(
            inputs["z"], t, condition, inputs["mask"], StepCondition(**further) if further else None
        )
    _compare(folder / "denoiser.onnx", inputs | further, expected)
    if (folder / "decoder.onnx").is_file():
        latents = torch.randn(count, tokens, width)
        with torch.no_grad():
            expected = model.vae.decode(latents, frames)
        _compare(folder / "decoder.onnx", {"latents": latents, "mask": frames}, expected)
    if (folder / cards.ENCODER_FILE).is_file():
        features = torch.randn(*frames.shape, len(card.normalizer_mean))
        with torch.no_grad():
            expected = model.vae.encode(features, frames).mean
        _compare(folder / cards.ENCODER_FILE, {"features": features, "mask": frames}, expected)
    if (folder / PULLBACK_FILE).is_file():
        error = graphs.pullback_error(model.vae, folder / PULLBACK_FILE)
        if not error < graphs.PULLBACK_TOLERANCE:
            raise ModelError(
                f"{PULLBACK_FILE} differs from its decoder by {error:.2g}; not written"
            )
    for steps in _fused_steps(card):
        guidance = torch.full((count,), 1.5)
        inputs = {**drawn("noise"), "frames": frames, "guidance": guidance}
        with torch.no_grad():
            expected = graphs.FusedSampler(model, steps)(**inputs)
        _compare(folder / fused_sampler_file(steps), inputs, expected)


def _compare(graph: Path, inputs: dict[str, torch.Tensor], expected: torch.Tensor) -> None:
    """Raises ModelError if a graph's output differs from the expected one."""
    session = open_session(graph, "onnxruntime")
    actual = session(**{name: tensor.numpy() for name, tensor in inputs.items()})
    difference = float(np.abs(actual - expected.numpy()).max())
    tolerance = TOLERANCE[cards.read_card(graph.parent).precision]
    if not difference < tolerance * max(1.0, float(expected.abs().max())):
        raise ModelError(f"{graph.name} differs from its network by {difference:.2g}; not written")


Model = TypeVar("Model", bound=FirstStageModel)

# Prefixes of figures that depend on the decoder alone.
_OF_DECODER = ("vae_", "decoder_")

# Prefixes of figures that do not depend on the decoder.
_OF_DENOISER = ("denoiser_", "student_", "teacher")


def with_decoder(model: Model, other: FirstStageModel) -> Model:
    """Returns `model` with the decoder of `other`.

    Raises:
        InputError: Their latents are not the same.
        ModelError: One of them has no VAE.
    """
    check_latents(model, other)
    ours, theirs = model.card.provenance, other.card.provenance
    provenance = replace(
        ours,
        data=tuple(dict.fromkeys((*ours.data, *theirs.data))),
        data_hashes={**theirs.data_hashes, **ours.data_hashes},
        commands=tuple(dict.fromkeys((*ours.commands, *theirs.commands))),
        hours=round(ours.hours + other.card.figures.get("decoder_hours", 0.0), 3),
    )
    card = replace(
        model.card,
        vae=other.card.vae,
        provenance=provenance,
        figures={**other_figures(model.card), **decoder_figures(other.card)},
    )
    return replace(model, card=card, vae=other.vae)


def check_latents(model: FirstStageModel, other: FirstStageModel) -> None:
    """Checks that the latents of two models are the same.

    Raises:
        InputError: They differ.
        ModelError: One of them has no VAE.
    """
    pairs = {
        "encoders": (_encoder_of(model), _encoder_of(other)),
        "normalizers": (scale_of(model.card), scale_of(other.card)),
    }
    for what, (ours, theirs) in pairs.items():
        if ours != theirs:
            raise InputError(
                f"models {model.card.name!r} and {other.card.name!r} have different {what}, so one "
                "cannot read the other's latents; make a decoder for them: latentmotion train "
                "decoder"
            )


def scale_of(card: ModelCard) -> tuple[str, tuple[float, ...], tuple[float, ...]]:
    """Returns the representation of a model and the scale of its features."""
    return card.representation, card.normalizer_mean, card.normalizer_std


def other_figures(card: ModelCard) -> dict[str, Any]:
    """Returns the figures of a model that hold with any decoder."""
    return {k: value for k, value in card.figures.items() if k.startswith(_OF_DENOISER)}


def decoder_figures(card: ModelCard) -> dict[str, Any]:
    """Returns the figures of a model's decoder."""
    return {k: value for k, value in card.figures.items() if k.startswith(_OF_DECODER)}


def _encoder_of(model: FirstStageModel) -> str:
    if not model.card.vae.has_weights:
        raise ModelError(f"model {model.card.name!r} has no VAE: run latentmotion train vae")
    return fingerprint(model.vae)
