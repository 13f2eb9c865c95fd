"""What a run's model folder says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from latentmotion.baselines.vposer_t import VPoserTConfig
from latentmotion.checkpoint import describe
from latentmotion.data.dataset import Dataset
from latentmotion.experiment import Experiment
from latentmotion.model_card import LatentSpace, ModelCard
from latentmotion.training.provenance import provenance_of
from latentmotion.training.steering import Steering
from latentmotion.vae.convolutional import ConvolutionalVAEConfig
from latentmotion.vae.convolutions import STRIDE
from latentmotion.vae.identity import IdentityVAEConfig


def first_stage_card(
    experiment: Experiment, dataset: Dataset, seconds: float, figures: Mapping[str, float]
) -> ModelCard:
    """Describes a trained VAE; what stage 2 will add is left out."""
    objective, cropping = experiment.denoiser_objective, experiment.latents.cropping
    return ModelCard(
        name=experiment.name,
        task=experiment.task,
        representation=dataset.representation.name,
        normalizer_mean=tuple(dataset.normalizer.mean.tolist()),
        normalizer_std=tuple(dataset.normalizer.std.tolist()),
        latents=latent_space(experiment),
        schedule=objective.schedule,
        prediction=objective.prediction,
        vae=describe(experiment.vae),
        denoiser={},
        condition={},
        frames=(cropping.min_frames, cropping.max_frames),
        provenance=provenance_of(dataset, seconds),
        figures={f"vae_{name}": round(value, 3) for name, value in figures.items()},
    )


def second_stage_card(
    experiment: Experiment,
    dataset: Dataset,
    first: ModelCard,
    steering: Steering,
    seconds: float,
    figures: Mapping[str, float],
) -> ModelCard:
    """Describes a finished model, given the card of its VAE with the latents' measured scale."""
    objective, cropping = experiment.denoiser_objective, experiment.latents.cropping
    rounded = {f"denoiser_{name}": round(value, 4) for name, value in figures.items()}
    return replace(
        first,
        name=experiment.name,
        task=experiment.task,
        schedule=objective.schedule,
        prediction=objective.prediction,
        denoiser=describe(experiment.denoiser),
        condition=steering.described,
        steps=experiment.sampling.steps,
        guidance=experiment.sampling.guidance if experiment.task != "unconditional" else 1.0,
        sampler=experiment.sampling.sampler,
        frames=(cropping.min_frames, cropping.max_frames),
        provenance=provenance_of(dataset, seconds, first.provenance),
        figures={**first.figures, **rounded},
    )


def latent_space(experiment: Experiment) -> LatentSpace:
    """Describes the latents of the experiment's VAE; their scale is not measured yet."""
    config = experiment.vae
    if isinstance(config, ConvolutionalVAEConfig):
        return LatentSpace(config.channels, frames_per_token=STRIDE)
    if isinstance(config, IdentityVAEConfig):
        return LatentSpace(config.features, frames_per_token=1)
    if isinstance(config, VPoserTConfig):
        return LatentSpace(config.width, tokens=1)
    return LatentSpace(config.latent_width or config.transformer.width, tokens=config.tokens)
