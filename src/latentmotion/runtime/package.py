"""A trained model becomes a folder that runs without PyTorch: card, weights, graphs, text encoder.

Weights are kept in 16 bits and the graphs are made from the rounded ones, so both say the same.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file

from latentmotion.checkpoint import WEIGHTS_FILE, TrainedModel, load_model
from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.errors import ModelError
from latentmotion.files import atomic_folder
from latentmotion.model_card import CARD_FILE, ModelCard
from latentmotion.runtime.export import export_decoder, export_denoiser
from latentmotion.runtime.session import open_session
from latentmotion.vae.interface import MotionVAE

TEXT_ENCODER_FILES = ("text_encoder.onnx", "tokenizer.json")
TOLERANCE = 1e-4
"""Largest difference between a graph and the network that it was made from."""


def package_model(source: Path, card: ModelCard, text_encoder: Path, output: Path) -> None:
    """Writes a folder from which `MotionGenerator.load` generates.

    Args:
        source: Folder that training wrote, with the weights of both networks.
        card: The card to write, as read from `source` or changed.
        text_encoder: Folder with `text_encoder.onnx` and `tokenizer.json`.
        output: Folder to write, replaced as a whole.

    Raises:
        ModelError: A file or network is missing, or a graph does not repeat its network.
    """
    _check_text_encoder(text_encoder)
    with atomic_folder(output, CARD_FILE) as folder:
        card.write(folder)
        weights = load_file(source / WEIGHTS_FILE)
        save_file({key: value.half() for key, value in weights.items()}, folder / WEIGHTS_FILE)
        for name in TEXT_ENCODER_FILES:
            shutil.copyfile(text_encoder / name, folder / name)
        _write_graphs(load_model(folder), folder)


def _check_text_encoder(folder: Path) -> None:
    missing = [name for name in TEXT_ENCODER_FILES if not (folder / name).is_file()]
    if missing:
        raise ModelError(
            f"{folder} lacks {', '.join(missing)}; make them: latentmotion train text-encoder"
        )


def _write_graphs(model: TrainedModel, folder: Path) -> None:
    if model.vae is None or model.denoiser is None:
        raise ModelError("the model lacks a VAE or a denoiser; train both stages first")
    card = model.card
    words = int(card.denoiser["condition_width"])
    export_decoder(model.vae, card.latents.frames_per_token, folder / "decoder.onnx")
    export_denoiser(model.denoiser, card.latents.width, words, folder / "denoiser.onnx")
    tokens = card.latents.tokens_of(card.frames[0])
    _check_denoiser(model.denoiser, folder, (3, tokens, card.latents.width), words)
    _check_decoder(model.vae, folder, (3, tokens, card.latents.width), card.frames[0])


def _check_denoiser(
    denoiser: Denoiser, folder: Path, shape: tuple[int, int, int], width: int
) -> None:
    z, words = torch.randn(shape), torch.randn(shape[0], 1, width)
    t, seen = torch.full(shape[:1], 0.5), torch.ones(shape[0], 1, dtype=torch.bool)
    mask = torch.ones(shape[:2], dtype=torch.bool)
    with torch.no_grad():
        expected = denoiser(z, t, Conditioning(words, seen), mask)
    inputs = {"z": z, "t": t, "words": words, "words_mask": seen, "mask": mask}
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
