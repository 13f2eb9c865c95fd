"""Another decoder for the latents of a trained model: cheaper, or learned again.

The encoder stays as it is to the bit, so that the model's denoiser fits as before.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path

import torch

from latentmotion.checkpoint import WEIGHTS_FILE, FirstStageModel, load_stages, save_model
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError, ModelError
from latentmotion.exchange import check_latents, other_figures, scale_of
from latentmotion.experiment import Experiment, differing_keys
from latentmotion.model.card import ModelCard, read_card
from latentmotion.model.vae_config import VAEConfig
from latentmotion.networks.build import build
from latentmotion.storage.files import sha256
from latentmotion.training.devices import Place
from latentmotion.training.imitation import ImitatingStage, load_imitation
from latentmotion.training.loop import train
from latentmotion.training.provenance import provenance_of
from latentmotion.training.run_folder import MODEL, Run, open_run
from latentmotion.training.vae_stage import VAEStage
from latentmotion.vae.halves import first_half, keep_latents
from latentmotion.vae.interface import MotionVAE


def train_decoder(
    experiment: Experiment,
    data: Path,
    model: Path,
    folder: Path,
    place: Place,
    imitated: Path | None = None,
) -> Path:
    """Trains a decoder for a model's latents, or goes on with it; returns the whole model's folder.

    Args:
        experiment: Its VAE has the model's encoder; stage 1's settings say how to train.
        data: Prepared folder.
        model: Model folder, with or without a denoiser.
        folder: Run folder.
        place: The device and rank.
        imitated: Run folder of a distillation, to learn from its decoder on what it generated.

    Raises:
        DataError: The data cannot be used.
        ModelError: The model is missing or has no VAE, or the distillation has not ended.
        InputError: The run folder holds another run, or model, data and decoder do not fit.
    """
    dataset, training = Dataset.load(data), experiment.vae_training
    trained = load_stages(model)
    check_data(trained.card, dataset)
    torch.manual_seed(training.seed)
    vae = vae_with_latents_of(trained, experiment.vae)
    imitation = load_imitation(imitated, trained) if imitated else None
    parents = {"model": sha256(model / WEIGHTS_FILE)}
    if imitation:
        parents["imitated"] = imitation.fingerprint
    open_run(folder, Run("decoder", dataset.fingerprint, parents, experiment), place)
    parts = vae, dataset, experiment, place
    stage = ImitatingStage(*parts, imitation) if imitation else VAEStage(*parts)
    vae, seconds = train(stage, training, folder, place)
    if place.leads:
        card = decoder_card(trained.card, experiment, dataset, seconds, stage.validate(vae))
        made = replace(trained, card=card, vae=vae)
        check_latents(trained, made)
        save_model(folder / MODEL, made)
    return folder / MODEL


def cheaper_vae(model: Path) -> VAEConfig:
    """Returns the configuration of a model's VAE, with the decoder that costs least.

    Raises:
        ModelError: The model is missing, or there is no cheaper decoder for its VAE.
    """
    card = read_card(model)
    config = card.vae.with_light_decoder()
    if config is None:
        raise ModelError(
            f"model {card.name!r} has a VAE {type(card.vae).__name__}, for which there is no "
            "cheaper decoder; take a convolutional or a transformer VAE"
        )
    return config


def vae_with_latents_of(trained: FirstStageModel, config: VAEConfig) -> MotionVAE:
    """Builds a VAE with a model's encoder, frozen.

    Raises:
        ModelError: The model has no VAE.
        InputError: The encoder is another.
    """
    if not trained.card.vae.has_weights:
        raise ModelError(f"model {trained.card.name!r} has no VAE: run latentmotion train vae")
    vae = build(config)
    found, wanted = _sizes(vae), _sizes(trained.vae)
    if found != wanted:
        raise _another_encoder(trained.card, *islice(differing_keys(wanted, found), 3))
    keep_latents(vae, trained.vae)
    if not _encode_alike(vae, trained.vae, trained.card):
        raise _another_encoder(trained.card, "of weights of the same shapes")
    return vae


def check_data(card: ModelCard, dataset: Dataset) -> None:
    """Compares a model's features with those of prepared data.

    Raises:
        InputError: They are others, or scaled otherwise.
    """
    mean, std = dataset.normalizer.mean, dataset.normalizer.std
    if (dataset.representation.name, tuple(mean.tolist()), tuple(std.tolist())) != scale_of(card):
        raise InputError(
            f"{dataset.folder} has other features than model {card.name!r} knows, or another "
            "normalizer; use the data that it was trained on"
        )


def decoder_card(
    trained: ModelCard,
    experiment: Experiment,
    dataset: Dataset,
    seconds: float,
    figures: dict[str, float],
) -> ModelCard:
    """Describes a model with its new decoder; what was measured of the old one is left out."""
    rounded = {f"vae_{name}": round(value, 3) for name, value in figures.items()}
    before = trained.figures.get("decoder_hours", 0.0)
    hours = {"decoder_hours": round(before + seconds / 3600, 3)}
    return replace(
        trained,
        vae=experiment.vae,
        provenance=provenance_of(dataset, seconds, trained.provenance),
        figures={**other_figures(trained), **rounded, **hours},
    )


def _sizes(vae: MotionVAE) -> dict[str, list[int]]:
    return {name: list(value.shape) for name, value in first_half(vae).items()}


def _encode_alike(vae: MotionVAE, other: MotionVAE, card: ModelCard) -> bool:
    """Returns whether both make the same latents; weights do not tell dilations, heads and such."""
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(1, card.frames[1], len(card.normalizer_mean), generator=generator)
    mask = torch.ones(features.shape[:2], dtype=torch.bool)
    with torch.no_grad():
        means = [one.eval().encode(features, mask).mean for one in (vae, other)]
    return torch.equal(*means)


def _another_encoder(card: ModelCard, *how: str) -> InputError:
    return InputError(
        f"model {card.name!r} has another encoder ({', '.join(how)}); change nothing of vae but "
        "its decoder (or decoding)"
    )
