"""A trained model becomes a folder that runs without PyTorch: card, weights, graphs, text encoder.

Weights are kept in 16 bits and the graphs are made from the rounded ones, so both say the same.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file

from latentmotion.checkpoint import WEIGHTS_FILE, TrainedModel, load_model, read_weights
from latentmotion.condition.interface import Conditioning
from latentmotion.condition.text.graph import GRAPH_FILE, TOKENIZER_FILE
from latentmotion.condition.text.student import load_text_encoder
from latentmotion.diffusion.context import LeapEmbedding
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.leaps import Leap
from latentmotion.errors import ModelError
from latentmotion.files import atomic_folder
from latentmotion.model_card import CARD_FILE, ModelCard
from latentmotion.runtime.export import export_decoder, export_denoiser
from latentmotion.runtime.session import has_decoder, open_session
from latentmotion.vae.interface import MotionVAE

TOLERANCE = 1e-4
"""Largest difference between a graph and the network that it was made from."""


WriteTextEncoder = Callable[[Path], None]
"""Writes the files of a text encoder into a folder."""


def package_model(
    source: Path, card: ModelCard, text_encoder: WriteTextEncoder | None, output: Path
) -> None:
    """Writes a folder from which `MotionGenerator.load` generates.

    Args:
        source: Folder that training wrote, with the weights of all networks.
        card: The card to write, as read from `source` or changed.
        text_encoder: Writes the text encoder; None for models of actions and unconditional ones.
        output: Folder to write, replaced as a whole.

    Raises:
        ModelError: A file or network is missing, or a graph does not repeat its network.
    """
    if not card.denoiser:
        raise ModelError(f"model {card.name!r} lacks a denoiser; train both stages first")
    if card.task == "text" and text_encoder is None:
        raise ModelError(f"model {card.name!r} reads sentences; pass its text encoder")
    with atomic_folder(output, CARD_FILE) as folder:
        card.write(folder)
        weights = read_weights(source / WEIGHTS_FILE)
        save_file({key: _halved(value) for key, value in weights.items()}, folder / WEIGHTS_FILE)
        if text_encoder is not None:
            text_encoder(folder)
            _check_width(card, folder)
        _write_graphs(load_model(folder), folder)


def copied(folder: Path) -> WriteTextEncoder:
    """Returns what copies a text encoder from another folder.

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
        for name in names:
            shutil.copyfile(folder / name, target / name)

    return write


def _halved(weights: torch.Tensor) -> torch.Tensor:
    return weights.half() if weights.is_floating_point() else weights


def _check_width(card: ModelCard, folder: Path) -> None:
    found, expected = load_text_encoder(folder).width, int(card.denoiser["condition_width"])
    if found != expected:
        raise ModelError(
            f"the text encoder has {found} numbers per vector, model {card.name!r} reads "
            f"{expected}; it was trained with {card.condition.get('encoder', 'another')!r}"
        )


def _write_graphs(model: TrainedModel, folder: Path) -> None:
    card, denoiser = model.card, model.denoiser
    assert denoiser is not None  # the card has one
    width = int(card.denoiser["condition_width"])
    export_denoiser(denoiser, card.latents.width, width, folder / "denoiser.onnx")
    shape = (3, card.latents.tokens_of(card.frames[0]), card.latents.width)
    words = 0 if card.task == "unconditional" else 1
    _check_denoiser(denoiser, folder, shape, (3, words, width))
    if model.vae is not None and has_decoder(card):
        export_decoder(model.vae, card.latents.frames_per_token, folder / "decoder.onnx")
        _check_decoder(model.vae, folder, shape, card.frames[0])


def _check_denoiser(
    denoiser: Denoiser, folder: Path, shape: tuple[int, int, int], seen: tuple[int, int, int]
) -> None:
    z, words = torch.randn(shape), torch.randn(seen)
    t, real = torch.full(shape[:1], 0.5), torch.ones(seen[:2], dtype=torch.bool)
    mask = torch.ones(shape[:2], dtype=torch.bool)
    told = {"guidance": 3 * t, "stride": t} if isinstance(denoiser.leaps, LeapEmbedding) else {}
    with torch.no_grad():
        expected = denoiser(z, t, Conditioning(words, real), mask, Leap(**told) if told else None)
    inputs = {"z": z, "t": t, "words": words, "words_mask": real, "mask": mask, **told}
    _compare(folder / "denoiser.onnx", inputs, expected)


def _check_decoder(vae: MotionVAE, folder: Path, shape: tuple[int, int, int], frames: int) -> None:
    latents, mask = torch.randn(shape), torch.ones(shape[0], frames, dtype=torch.bool)
    with torch.no_grad():
        expected = vae.decode(latents, mask)
    _compare(folder / "decoder.onnx", {"latents": latents, "mask": mask}, expected)


def _compare(graph: Path, inputs: dict[str, torch.Tensor], expected: torch.Tensor) -> None:
    session = open_session(graph, "onnxruntime")
    found = session(**{name: tensor.numpy() for name, tensor in inputs.items()})
    difference = float(np.abs(found - expected.numpy()).max())
    if not difference < TOLERANCE * max(1.0, float(expected.abs().max())):
        raise ModelError(f"{graph.name} differs from its network by {difference:.2g}; not written")
