"""A trained model becomes a folder that runs without PyTorch: card, weights, graphs, text encoder.

Weights are kept in 16 bits and the graphs are made from the rounded ones, so both say the same.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import onnx
import torch
from safetensors.torch import save_file

from latentmotion.checkpoint import (
    ENCODER_HASH,
    WEIGHTS_FILE,
    LatentModel,
    encoder_hash,
    encoder_holder,
    encoder_weights,
    load_model,
    model_weights,
)
from latentmotion.condition.interface import Conditioning
from latentmotion.condition.text.encoder_files import GRAPH_FILE, TOKENIZER_FILE
from latentmotion.condition.text.lengths import LENGTHS_FILE
from latentmotion.condition.text.student import load_text_encoder
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.leaps import Leap
from latentmotion.errors import ModelError
from latentmotion.model.card import CARD_FILE, GraphPrecision, ModelCard, read_card
from latentmotion.runtime.export import (
    FusedSampler,
    export_decoder,
    export_denoiser,
    export_fused_sampler,
)
from latentmotion.runtime.quantization import quantize
from latentmotion.runtime.session import fused_sampler_file, has_decoder, open_session
from latentmotion.runtime.shared_weights import share_weights
from latentmotion.storage.files import atomic_folder
from latentmotion.tracing import anonymous
from latentmotion.vae.interface import MotionVAE

TOLERANCE: dict[GraphPrecision, float] = {"float32": 1e-4, "int8": 0.1}
"""Largest difference between a graph and the network that it was made from."""

MOST_FUSED = 4
"""Most steps that get a fused sampler; the gain is per motion, the size per step."""

WriteTextEncoder = Callable[[Path], None]
"""Writes the files of a text encoder into a folder."""


def package_model(
    source: Path,
    card: ModelCard,
    text_encoder: WriteTextEncoder | None,
    output: Path,
    share_encoder: bool = False,
) -> None:
    """Writes a folder from which `MotionPipeline.from_pretrained` generates.

    Args:
        source: Folder that training wrote, with the weights of all networks.
        card: The card to write, as read from `source` or changed; it says in which precision.
        text_encoder: Writes the text encoder; None for models of actions and unconditional ones.
        output: Folder to write, replaced as a whole.
        share_encoder: Whether to leave the VAE's encoder to a shipped model that has the same.

    Raises:
        ModelError: A file or network is missing, a graph does not repeat its network, or no
            shipped model has the encoder.
    """
    width = card.trained_denoiser.condition_width
    if card.condition.reads_text and text_encoder is None:
        raise ModelError(f"model {card.name!r} reads sentences; pass its text encoder")
    with atomic_folder(output, CARD_FILE) as folder:
        card.write(folder)
        weights = {key: _halved(value) for key, value in model_weights(source).items()}
        left_out = _shared_encoder(weights, output) if share_encoder else {}
        kept = {key: value for key, value in weights.items() if key not in left_out}
        metadata = {ENCODER_HASH: encoder_hash(left_out)} if left_out else None
        save_file(kept, folder / WEIGHTS_FILE, metadata)
        if text_encoder is not None:
            text_encoder(folder)
            _check_width(card, width, folder)
        _write_graphs(load_model(folder), folder)


def copied(folder: Path) -> WriteTextEncoder:
    """Returns what copies a text encoder, and lengths beside it, from another folder.

    Raises:
        ModelError: It is not there.
    """
    names = GRAPH_FILE, TOKENIZER_FILE
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise ModelError(
            f"{folder} lacks {', '.join(missing)}; make them: latentmotion train text-encoder"
        )

    def write(target: Path) -> None:
        onnx.save(anonymous(onnx.load(folder / GRAPH_FILE)), target / GRAPH_FILE)
        shutil.copyfile(folder / TOKENIZER_FILE, target / TOKENIZER_FILE)
        if (folder / LENGTHS_FILE).is_file():
            shutil.copyfile(folder / LENGTHS_FILE, target / LENGTHS_FILE)

    return write


def _shared_encoder(weights: Mapping[str, torch.Tensor], output: Path) -> dict[str, torch.Tensor]:
    encoder = encoder_weights(weights)
    if not encoder or encoder_holder(encoder_hash(encoder), besides=output) is None:
        raise ModelError(
            "no shipped model has this VAE's encoder, so it cannot be left out; export without "
            "--share-encoder"
        )
    return encoder


def _halved(weights: torch.Tensor) -> torch.Tensor:
    return weights.half() if weights.is_floating_point() else weights


def _check_width(card: ModelCard, expected: int, folder: Path) -> None:
    found = load_text_encoder(folder).width
    if found != expected:
        raise ModelError(
            f"the text encoder has {found} numbers per vector, model {card.name!r} reads "
            f"{expected}; it was trained with {card.condition.text_encoder or 'another'!r}"
        )


def _write_graphs(model: LatentModel, folder: Path) -> None:
    card, width = model.card, model.card.trained_denoiser.condition_width
    export_denoiser(model.denoiser, card.latents.width, width, folder / "denoiser.onnx")
    if has_decoder(card):
        export_decoder(model.vae, card.latents.frames_per_token, folder / "decoder.onnx")
    for steps in _fused_steps(card):
        export_fused_sampler(model, steps, folder / fused_sampler_file(steps))
    for graph in folder.glob("*.onnx"):
        if card.precision == "int8":
            quantize(graph)
        if graph.name != GRAPH_FILE:  # whose weights are its own
            share_weights(graph, folder / WEIGHTS_FILE)
    _check_graphs(model, folder)


def _fused_steps(card: ModelCard) -> list[int]:
    """Returns which numbers of steps get a fused sampler."""
    return [steps for steps in card.leaps.steps if steps <= MOST_FUSED] if card.leaps else []


def _check_graphs(model: LatentModel, folder: Path) -> None:
    card = model.card
    tokens, width = card.latents.tokens_of(card.frames[0]), card.latents.width
    words = 1 if card.condition.prompted else 0
    shape, seen = (3, tokens, width), (3, words, card.trained_denoiser.condition_width)
    _check_denoiser(model.denoiser, folder, shape, seen)
    if (folder / "decoder.onnx").is_file():
        _check_decoder(model.vae, folder, shape, card.frames[0])
    for steps in _fused_steps(card):
        _check_fused_sampler(
            FusedSampler(model, steps), folder / fused_sampler_file(steps), shape, seen
        )


def _check_denoiser(
    denoiser: Denoiser, folder: Path, shape: tuple[int, int, int], seen: tuple[int, int, int]
) -> None:
    z, words = torch.randn(shape), torch.randn(seen)
    t, real = torch.full(shape[:1], 0.5), torch.ones(seen[:2], dtype=torch.bool)
    mask = torch.ones(shape[:2], dtype=torch.bool)
    told = {"guidance": 3 * t, "stride": t} if denoiser.further_inputs else {}
    with torch.no_grad():
        expected = denoiser(z, t, Conditioning(words, real), mask, Leap(**told) if told else None)
    inputs = {"z": z, "t": t, "words": words, "words_mask": real, "mask": mask, **told}
    _compare(folder / "denoiser.onnx", inputs, expected)


def _check_decoder(vae: MotionVAE, folder: Path, shape: tuple[int, int, int], frames: int) -> None:
    latents, mask = torch.randn(shape), torch.ones(shape[0], frames, dtype=torch.bool)
    with torch.no_grad():
        expected = vae.decode(latents, mask)
    _compare(folder / "decoder.onnx", {"latents": latents, "mask": mask}, expected)


def _check_fused_sampler(
    sampler: FusedSampler, graph: Path, shape: tuple[int, int, int], seen: tuple[int, int, int]
) -> None:
    inputs = {
        "noise": torch.randn(shape),
        "words": torch.randn(seen),
        "words_mask": torch.ones(seen[:2], dtype=torch.bool),
        "mask": torch.ones(shape[:2], dtype=torch.bool),
        "frames": torch.ones(shape[0], sampler.card.frames[0], dtype=torch.bool),
        "guidance": torch.full(shape[:1], 1.5),
    }
    with torch.no_grad():
        expected = sampler(**inputs)
    _compare(graph, inputs, expected)


def _compare(graph: Path, inputs: dict[str, torch.Tensor], expected: torch.Tensor) -> None:
    session = open_session(graph, "onnxruntime")
    found = session(**{name: tensor.numpy() for name, tensor in inputs.items()})
    difference = float(np.abs(found - expected.numpy()).max())
    tolerance = TOLERANCE[read_card(graph.parent).precision]
    if not difference < tolerance * max(1.0, float(expected.abs().max())):
        raise ModelError(f"{graph.name} differs from its network by {difference:.2g}; not written")
