"""The two stages of the paper, each a function: data, network, loop, model folder."""

from __future__ import annotations

from pathlib import Path

import torch

from latentmotion.checkpoint import TrainedModel, describe, save_model
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.experiment import Experiment
from latentmotion.model_card import LatentSpace, ModelCard
from latentmotion.training.devices import Place
from latentmotion.training.loop import train
from latentmotion.training.provenance import provenance_of
from latentmotion.training.run_folder import Run, open_run
from latentmotion.training.vae_stage import VAEStage
from latentmotion.vae.convolutional import STRIDE, ConvolutionalVAEConfig

MODEL = "model"
"""Where in a run folder the trained model is put."""


def train_vae(experiment: Experiment, data: Path, folder: Path, place: Place) -> Path:
    """Trains stage 1, or goes on with it; returns the model folder.

    Raises:
        DataError: The data cannot be used.
        InputError: The run folder holds another run, or features and network do not fit.
    """
    dataset = Dataset.load(data)
    check_width(experiment, dataset)
    open_run(folder, Run("vae", dataset.fingerprint, {}, experiment), place)
    torch.manual_seed(experiment.vae_training.seed)
    stage = VAEStage(experiment.vae.build(), dataset, experiment, place)
    vae, seconds = train(stage, experiment.vae_training, folder, place)
    card = card_of(experiment, dataset, seconds, latent_space(experiment), stage.validate(vae))
    if place.leads:
        save_model(folder / MODEL, TrainedModel(card, vae, None))
    return folder / MODEL


def check_width(experiment: Experiment, dataset: Dataset) -> None:
    """Raises InputError where the VAE is made for features of another width."""
    found, expected = dataset.representation.width, experiment.vae.features
    if found != expected:
        raise InputError(
            f"{dataset.folder} has {found} features a frame ({dataset.representation.name}), the "
            f"experiment's VAE takes {expected}; use --set vae.features={found}"
        )


def latent_space(
    experiment: Experiment, mean: tuple[float, ...] = (0.0,), std: tuple[float, ...] = (1.0,)
) -> LatentSpace:
    """Describes the latents of the experiment's VAE."""
    config = experiment.vae
    if isinstance(config, ConvolutionalVAEConfig):
        return LatentSpace(config.channels, None, STRIDE, mean, std)
    return LatentSpace(config.transformer.width, config.tokens, None, mean, std)


def card_of(
    experiment: Experiment,
    dataset: Dataset,
    seconds: float,
    latents: LatentSpace,
    figures: dict[str, float],
) -> ModelCard:
    """Describes the model that the experiment makes from the data, its denoiser left out."""
    objective, cropping = experiment.denoiser_objective, experiment.latents.cropping
    return ModelCard(
        name=experiment.name,
        task="text",
        representation=dataset.representation.name,
        normalizer_mean=tuple(dataset.normalizer.mean.tolist()),
        normalizer_std=tuple(dataset.normalizer.std.tolist()),
        latents=latents,
        schedule=objective.schedule,
        prediction=objective.prediction,
        vae=describe(experiment.vae),
        denoiser={},
        condition={},
        steps=experiment.sampling.steps,
        guidance=experiment.sampling.guidance,
        frames=(cropping.min_frames, cropping.max_frames),
        provenance=provenance_of(dataset, seconds),
        figures={f"vae_{name}": round(value, 3) for name, value in figures.items()},
    )
