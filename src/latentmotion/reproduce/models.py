"""Models of the tables, from `models.toml`: one per row or shared by several.

A model starts from a preset and changes parts of it, in the paper's sizes; a budget then makes the
experiment smaller. The first stage is that of the model itself, or that of another.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from latentmotion.model import config
from latentmotion.reproduce.budget import Budget
from latentmotion.storage.configuration import from_json
from latentmotion.training.experiment import Experiment, preset_named, with_settings

FIRST_STAGE = ("vae", "vae_objective", "vae_cropping", "vae_training", "mirrored")
"""Parts of an experiment that determine the first stage."""


@dataclass(frozen=True)
class Model:
    """A trained model, which one or several rows measure."""

    name: str
    """Folder of its runs."""
    preset: str = "mld_humanml3d"
    """Preset that it starts from."""
    set: dict[str, Any] = field(default_factory=dict)
    """Settings that differ from the preset's, in the paper's sizes."""
    task: Literal["text", "action", "unconditional"] = "text"
    """Task of the denoiser."""
    first: str = ""
    """Model whose first stage it uses; empty for its own."""
    encoder: str = ""
    """Name of its text encoder; empty for the one that the command names."""
    shipped: str = ""
    """Model that ships, which is taken as it is; empty for one that is trained."""
    equal: Literal["", "FLOPs", "crops"] = ""
    """What its training has as much of as both stages of MLD-1 of z₀; empty for the budget's
    steps."""

    @property
    def raw(self) -> bool:
        """Whether it diffuses raw frames, without a first stage."""
        return isinstance(preset_named(self.preset).vae, config.IdentityVAEConfig)

    def experiment(self) -> Experiment:
        """Returns the changed preset, in the paper's sizes."""
        return with_settings(preset_named(self.preset), self.set)

    def first_stage(self, budget: Budget, features: int) -> Experiment:
        """Returns the experiment that trains the VAE; parts of the second stage are the preset's.

        Args:
            budget: Sizes.
            features: Features per frame of the data.
        """
        changed = self.experiment()
        parts = {part: getattr(changed, part) for part in (*FIRST_STAGE, "latents")}
        experiment = replace(preset_named(self.preset), name=self.name, **parts)
        return _fitted(budget.shrink(experiment), features)

    def second_stage(
        self, first: Experiment, budget: Budget, features: int, condition_width: int | None
    ) -> Experiment:
        """Returns the experiment that trains the denoiser.

        Args:
            first: Experiment of the VAE.
            budget: Sizes.
            features: Features per frame of the data.
            condition_width: Width of the text encoder; None if there is none.
        """
        changed = replace(self.experiment(), name=self.name, task=self.task)
        experiment = _fitted(budget.shrink(changed), features)
        if not self.raw:
            experiment = replace(experiment, **{p: getattr(first, p) for p in FIRST_STAGE})
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
    """Fits the VAE to the features of the data and, if its length is fixed, to the longest crop."""
    vae = experiment.vae.for_data(features, experiment.vae_cropping.max_frames)
    return replace(experiment, vae=vae)


MODELS = {
    name: from_json(Model, {"name": name, **row})
    for name, row in tomllib.loads(
        Path(__file__).with_name("models.toml").read_text(encoding="utf-8")
    ).items()
}
"""Every model of the tables by name."""
