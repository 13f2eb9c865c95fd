"""The pipeline on PyTorch, for any model folder: a training's, a converted one, an exported one.

    host: prompts → words, seeds → noise       device: noise, words → latents → features → joints

The networks are sessions, as graphs of ONNX are. Noise is drawn on the CPU, so that a seed means
the same motion everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from latentmotion.checkpoint import load_model, load_stages
from latentmotion.condition.interface import Conditioning, TextEncoder
from latentmotion.condition.text.pretrained import local_encoder
from latentmotion.condition.text.student import load_text_encoder
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.leaps import Leap
from latentmotion.errors import LatentMotionError, ModelError
from latentmotion.model.card import ModelCard
from latentmotion.model.folder import find_model
from latentmotion.pipeline import MAX_BATCH_SIZE, MotionPipeline
from latentmotion.prior import MotionPrior
from latentmotion.runtime.backend import Backend, Exact, directly
from latentmotion.runtime.buckets import Buckets
from latentmotion.runtime.computing import ON_CPU, Computing
from latentmotion.runtime.conditions import build_condition, encoder_folder, find_lengths
from latentmotion.runtime.device import device_named
from latentmotion.runtime.launch import Recorder, on_gpu
from latentmotion.runtime.network import network_session
from latentmotion.runtime.session import Session
from latentmotion.vae.interface import MotionVAE

GPU_BATCH_SIZE = 256
"""Motions that go through the networks of a GPU together."""


def torch_pipeline(
    folder: str | Path, encoder: TextEncoder | None = None, computing: Computing = ON_CPU
) -> MotionPipeline:
    """Loads the weights of any model folder, exported or not.

    Args:
        folder: Name or folder of the model.
        encoder: Text encoder; by default the folder's, else the one that the card names, where it
            is on this machine.
        computing: Where and how; by default on the CPU.

    Raises:
        ModelError: The folder is damaged, has no denoiser, or its text encoder is not at hand.
    """
    place = find_model(folder)
    model = load_model(place)
    condition = build_condition(model.card, lambda: encoder or find_encoder(model.card, place))
    backend = torch_backend(
        model.card,
        denoiser_session(model.denoiser, computing),
        decoder_session(model.vae, computing),
        computing,
    )
    lengths, most = find_lengths(model.card, place), _max_batch_size(computing)
    return MotionPipeline(model.card, condition, backend, most, lengths=lengths)


def torch_backend(
    card: ModelCard, denoiser: Session, decoder: Session, computing: Computing = ON_CPU
) -> Backend:
    """Returns sessions whose arrays are tensors of a device.

    From words to joints nothing leaves the device; where the chain is recorded or compiled,
    batches are filled up to few sizes.
    """
    repeats, device = computing.launch != "eager", device_named(computing.device)
    return Backend(
        denoiser,
        decoder,
        padding=Buckets(card) if repeats else Exact(),
        launch=Recorder(on_gpu(device)) if repeats and computing.on_gpu else directly,
        place=lambda array: torch.tensor(array, device=device),
        fetch=lambda tensor: tensor.cpu().numpy(),
    )


def torch_prior(folder: str | Path, computing: Computing = ON_CPU) -> MotionPrior:
    """Loads the VAE of any model folder, to sample its prior.

    Raises:
        ModelError: The folder is damaged or has no VAE.
    """
    model = load_stages(find_model(folder))
    return MotionPrior(
        model.card, decoder_session(model.vae, computing), _max_batch_size(computing)
    )


def prior_features(
    folder: str | Path,
    frames: Sequence[int],
    seeds: Sequence[int],
    computing: Computing = ON_CPU,
) -> list[Float[np.ndarray, "_ features"]]:
    """Returns features in their own units of motions drawn from a VAE's prior.

    Raises:
        ModelError: The folder is damaged or has no VAE.
        InputError: A number is out of range.
    """
    return torch_prior(folder, computing).features(frames, seeds)


def denoiser_session(denoiser: Denoiser, computing: Computing = ON_CPU) -> Session:
    """Returns a network as a session: z, t, words, words_mask, mask → prediction.

    A distilled one has two more inputs, guidance and stride.
    """

    def forward(
        z: Tensor, t: Tensor, words: Tensor, words_mask: Tensor, mask: Tensor, **told: Tensor
    ) -> Tensor:
        leap = Leap(**told) if told else None
        return denoiser(z, t, Conditioning(words, words_mask), mask, leap)

    return network_session(denoiser, forward, computing)


def decoder_session(vae: MotionVAE, computing: Computing = ON_CPU) -> Session:
    """Returns a VAE's decoder as a session: latents, mask → normalized features."""
    return network_session(vae, vae.decode, computing)


def find_encoder(card: ModelCard, folder: Path) -> TextEncoder:
    """Returns the text encoder in a model's folder, or on this machine the one its card names.

    Raises:
        ModelError: It is not at hand.
    """
    place = encoder_folder(card, folder)
    if place is not None:
        return load_text_encoder(place)
    name = card.condition.text_encoder or "none"
    try:
        return local_encoder(name)
    except LatentMotionError as error:
        raise ModelError(
            f"model {card.name!r} reads sentences with the text encoder {name!r}, which is not at "
            f"hand ({error}); pass it: --text-encoder FOLDER, or clip:FOLDER"
        ) from error


def _max_batch_size(computing: Computing) -> int:
    return GPU_BATCH_SIZE if computing.on_gpu else MAX_BATCH_SIZE
