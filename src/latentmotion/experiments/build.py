"""From a model of a table to the `Experiment` that trains it, in the sizes of a budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from latentmotion.experiment import Experiment, with_changes
from latentmotion.experiments.budget import Budget
from latentmotion.experiments.table import Model
from latentmotion.presets.fast import fast
from latentmotion.presets.mdm import mdm, mdm_50
from latentmotion.presets.mld_humanml3d import mld_humanml3d
from latentmotion.presets.starter import starter

BASES: dict[str, Callable[[], Experiment]] = {
    "mld": mld_humanml3d,
    "mdm": mdm,
    "mdm_50": mdm_50,
    "starter": starter,
    "fast": fast,
}
"""What a model is changed from."""

FIRST_STAGE = ("vae", "vae_objective", "vae_cropping", "vae_training", "mirrored")
"""Parts of an experiment that decide what its first stage yields."""


def first_stage_of(model: Model, budget: Budget, features: int) -> Experiment:
    """Returns what trains a model's VAE; the parts of stage 2 are the base's."""
    changed = with_changes(BASES[model.base](), model.changes)
    parts = {part: getattr(changed, part) for part in (*FIRST_STAGE, "latents")}
    experiment = replace(BASES[model.base](), name=model.name, **parts)
    return _fitted(budget.shrink(experiment), features)


def second_stage_of(
    model: Model, first: Experiment, budget: Budget, features: int, condition_width: int | None
) -> Experiment:
    """Returns what trains a model's diffusion.

    Args:
        model: The model.
        first: What its VAE was trained with.
        budget: Its sizes.
        features: Numbers per frame of the data.
        condition_width: Numbers per word of the text encoder; None where there is none.
    """
    changed = with_changes(BASES[model.base](), model.changes)
    fitted = _fitted(budget.shrink(replace(changed, name=model.name, task=model.task)), features)
    parts = {part: getattr(first, part) for part in FIRST_STAGE}
    experiment = fitted if model.raw else replace(fitted, **parts)
    width = experiment.vae.latent_space().width
    denoiser = replace(
        experiment.denoiser,
        latent_width=width,
        condition_width=condition_width or experiment.denoiser.condition_width,
    )
    if not denoiser.project_latents:
        denoiser = replace(denoiser, transformer=replace(denoiser.transformer, width=width))
    return replace(experiment, denoiser=denoiser)


def _fitted(experiment: Experiment, features: int) -> Experiment:
    """Fits the VAE to the data's features, and one of a fixed length to the longest crop."""
    vae = experiment.vae.fitted(features, experiment.vae_cropping.max_frames)
    return replace(experiment, vae=vae)
