"""What a run's model folder says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from latentmotion.condition.task import TASKS
from latentmotion.data.dataset import Dataset
from latentmotion.model.card import ModelCard
from latentmotion.training.experiment import Experiment
from latentmotion.training.run_folder import provenance_of
from latentmotion.training.task_conditions import TaskConditioning


def first_stage_card(
    experiment: Experiment, dataset: Dataset, seconds: float, figures: Mapping[str, float]
) -> ModelCard:
    """Describes a trained VAE; what stage 2 will add is left out."""
    objective, cropping = experiment.denoiser_objective, experiment.latents.cropping
    return ModelCard(
        name=experiment.name,
        representation=dataset.representation.name,
        normalizer_mean=tuple(dataset.normalizer.mean.tolist()),
        normalizer_std=tuple(dataset.normalizer.std.tolist()),
        latents=experiment.vae.latent_space(),
        schedule=objective.schedule,
        parametrization=objective.parametrization,
        vae=experiment.vae,
        denoiser=None,
        condition=TASKS[experiment.task](),
        frames=(cropping.min_frames, cropping.max_frames),
        provenance=provenance_of(dataset, seconds),
        figures={f"vae_{name}": round(value, 3) for name, value in figures.items()},
    )


def second_stage_card(
    experiment: Experiment,
    dataset: Dataset,
    first: ModelCard,
    conditioning: TaskConditioning,
    seconds: float,
    figures: Mapping[str, float],
) -> ModelCard:
    """Describes a finished model, given the card of its VAE with the latents' measured scale."""
    objective, cropping = experiment.denoiser_objective, experiment.latents.cropping
    rounded = {f"denoiser_{name}": round(value, 4) for name, value in figures.items()}
    return replace(
        first,
        name=experiment.name,
        schedule=objective.schedule,
        parametrization=objective.parametrization,
        denoiser=experiment.denoiser,
        condition=conditioning.task,
        sampling=experiment.sampling.but(guidance=None if conditioning.task.prompted else 1.0),
        frames=(cropping.min_frames, cropping.max_frames),
        provenance=provenance_of(dataset, seconds, first.provenance),
        figures={**first.figures, **rounded},
    )
