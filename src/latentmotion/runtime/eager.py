"""The chain on PyTorch, for model folders that were not exported: a training's, a converted one.

The networks take and give NumPy arrays by name, as sessions of ONNX graphs do, so that the
generator does not know which it has; sampling itself is the generator's, on the CPU.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from latentmotion import generator
from latentmotion.checkpoint import TrainedModel, load_model
from latentmotion.condition.interface import Conditioning, TextEncoder
from latentmotion.condition.text.graph import GRAPH_FILE
from latentmotion.condition.text.pretrained import local_encoder
from latentmotion.condition.text.student import load_text_encoder
from latentmotion.diffusion.denoiser import Denoiser
from latentmotion.diffusion.leaps import Leap
from latentmotion.errors import LatentMotionError, ModelError
from latentmotion.generator import MotionGenerator
from latentmotion.model_card import ModelCard
from latentmotion.models import find_model, shipped_models
from latentmotion.prior import MotionPrior
from latentmotion.runtime.conditions import build_condition
from latentmotion.runtime.device import device_named
from latentmotion.runtime.session import Session, raw_frames
from latentmotion.vae.interface import MotionVAE

MOST_AT_ONCE = 256
"""Motions that go through the networks of a GPU together."""


def eager_generator(
    folder: str | Path, encoder: TextEncoder | None = None, device: str = "cpu"
) -> MotionGenerator:
    """Loads the weights of any model folder, exported or not.

    Args:
        folder: Name or folder of the model.
        encoder: Text encoder; by default the folder's, else the one that the card names, where it
            is on this machine.
        device: Where the networks run, e.g. `cuda`.

    Raises:
        ModelError: The folder is damaged, has no denoiser, or its text encoder is not at hand.
    """
    place = find_model(folder)
    model = load_model(place)
    if model.denoiser is None:
        raise ModelError(
            f"{folder} has a VAE but no denoiser; train it: latentmotion train denoiser, "
            "or sample the VAE's prior: latentmotion generate --prior"
        )
    condition = build_condition(model.card, lambda: encoder or find_encoder(model.card, place))
    denoiser, decoder = denoiser_session(model.denoiser, device), _decoder(model, device)
    return MotionGenerator(model.card, condition, denoiser, decoder, _at_once(device))


def eager_prior(folder: str | Path, device: str = "cpu") -> MotionPrior:
    """Loads the VAE of any model folder, to sample its prior.

    Raises:
        ModelError: The folder is damaged or has no VAE.
    """
    model = load_model(find_model(folder))
    return MotionPrior(model.card, _decoder(model, device), _at_once(device))


def prior_features(
    folder: str | Path, frames: Sequence[int], seeds: Sequence[int], device: str = "cpu"
) -> list[Float[np.ndarray, "_ features"]]:
    """Returns features in their own units of motions drawn from a VAE's prior.

    Raises:
        ModelError: The folder is damaged or has no VAE.
        InputError: A number is out of range.
    """
    return eager_prior(folder, device).features(frames, seeds)


def denoiser_session(denoiser: Denoiser, device: str = "cpu") -> Session:
    """Returns a network as a session: z, t, words, words_mask, mask → prediction.

    A distilled one has two more inputs, guidance and stride.
    """

    def forward(
        z: Tensor, t: Tensor, words: Tensor, words_mask: Tensor, mask: Tensor, **told: Tensor
    ) -> Tensor:
        leap = Leap(**told) if told else None
        return denoiser(z, t, Conditioning(words, words_mask), mask, leap)

    return _session(denoiser, forward, device)


def decoder_session(vae: MotionVAE, device: str = "cpu") -> Session:
    """Returns a VAE's decoder as a session: latents, mask → normalized features."""
    return _session(vae, vae.decode, device)


def find_encoder(card: ModelCard, folder: Path) -> TextEncoder:
    """Returns the text encoder in a model's folder, or on this machine the one its card names.

    Raises:
        ModelError: It is not at hand.
    """
    place = encoder_folder(card, folder)
    if place is not None:
        return load_text_encoder(place)
    name = str(card.condition.get("encoder", "none"))
    try:
        return local_encoder(name)
    except LatentMotionError as error:
        raise ModelError(
            f"model {card.name!r} reads sentences with the text encoder {name!r}, which is not at "
            f"hand ({error}); pass it: --text-encoder FOLDER, or clip:FOLDER"
        ) from error


def encoder_folder(card: ModelCard, folder: Path) -> Path | None:
    """Returns the model's folder or a shipped one, whichever holds the encoder that it reads."""
    if (folder / GRAPH_FILE).is_file():
        return folder
    shipped = (find_model(model) for model in shipped_models())
    name = card.condition.get("encoder")
    return next((place for place in shipped if load_text_encoder(place).name == name), None)


def _decoder(model: TrainedModel, device: str) -> Session:
    return raw_frames if model.vae is None else decoder_session(model.vae, device)


def _session(network: nn.Module, forward: Callable[..., Tensor], device: str) -> Session:
    place = device_named(device)
    network.eval().requires_grad_(False).to(place)

    @torch.no_grad()
    def run(**inputs: np.ndarray) -> np.ndarray:
        tensors = {name: torch.tensor(array, device=place) for name, array in inputs.items()}
        return forward(**tensors).float().cpu().numpy()

    return run


def _at_once(device: str) -> int:
    return generator.MOST_AT_ONCE if device == "cpu" else MOST_AT_ONCE
