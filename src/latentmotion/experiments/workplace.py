"""Where a table's models are trained: each stage once, for all rows and tables that share it.

    FOLDER/MODEL/vae       stage 1, a run folder of `latentmotion train vae`
    FOLDER/MODEL/denoiser  stage 2, a run folder of `latentmotion train denoiser`

A stage that is there and ended is taken as it is, if it was made with the same data and settings;
one that was killed goes on.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from latentmotion.condition.interface import TextEncoder
from latentmotion.condition.task import TASKS
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.experiment import Experiment, differing_keys
from latentmotion.experiments.budget import Budget
from latentmotion.experiments.build import FIRST_STAGE, first_stage_of, second_stage_of
from latentmotion.experiments.models import MODELS
from latentmotion.experiments.table import Model
from latentmotion.model.card import CARD_FILE
from latentmotion.model.folder import find_model
from latentmotion.storage.configuration import read_json, to_json
from latentmotion.training.devices import Place
from latentmotion.training.run_folder import MODEL, NAME, Run
from latentmotion.training.stages import train_denoiser, train_vae
from latentmotion.training.steering import fitted, steering_of

SECOND_STAGE = (
    *FIRST_STAGE,
    "task",
    "latents",
    "denoiser",
    "denoiser_objective",
    "denoiser_training",
    "reading",
)
"""Parts of an experiment that decide what its second stage yields."""


@dataclass(frozen=True)
class Workplace:
    """The data, the sizes and the folder that all rows of a run share."""

    dataset: Dataset
    """What is trained on and measured."""
    folder: Path
    """Where runs and results are kept."""
    budget: Budget
    """Sizes."""
    place: Place
    """Device and rank."""
    encoders: Callable[[str], TextEncoder]
    """Text encoder by name."""
    encoder: str = "starter"
    """The one that most models read sentences with."""
    models: Mapping[str, Model] | None = None
    """Models by name; by default the paper's."""
    tell: Callable[[str], None] = print
    """Is told what happens."""

    def model(self, name: str) -> Model:
        """Returns a model of a table by name."""
        return (self.models or MODELS)[name]

    def encoder_of(self, model: Model) -> TextEncoder | None:
        """Returns the text encoder that a model reads sentences with, if any."""
        return (
            self.encoders(model.encoder or self.encoder) if TASKS[model.task].reads_text else None
        )

    def first_stage(self, name: str) -> Path:
        """Trains a model's VAE where it is not there yet; returns its model folder.

        Raises:
            InputError: The folder holds another run.
        """
        experiment, folder = self._first_stage(name)
        if not self._is_done(folder, experiment, FIRST_STAGE):
            self.tell(f"{folder}: training a VAE, {experiment.vae_training.steps} steps")
            train_vae(experiment, self.dataset.folder, folder, self.place)
        return folder / MODEL

    def both_stages(self, name: str) -> Path:
        """Trains what is missing of a model; returns its model folder.

        Raises:
            InputError: A folder holds another run.
        """
        model = self.model(name)
        if model.base == "starter":
            return find_model("starter")
        vae = None if model.raw else self.first_stage(model.first or name)
        first, _ = self._first_stage(model.first or name)
        encoder = self.encoder_of(model)
        width = encoder.width if encoder else None
        features = self.dataset.representation.width
        built = second_stage_of(model, first, self.budget, features, width)
        experiment = fitted(built, steering_of(built, self.dataset, encoder))
        folder = self.folder / name / "denoiser"
        if not self._is_done(folder, experiment, SECOND_STAGE):
            steps = experiment.denoiser_training.steps
            self.tell(f"{folder}: training a denoiser, {steps} steps")
            train_denoiser(experiment, self.dataset.folder, vae, encoder, folder, self.place)
        return folder / MODEL

    def _first_stage(self, name: str) -> tuple[Experiment, Path]:
        features = self.dataset.representation.width
        experiment = first_stage_of(self.model(name), self.budget, features)
        return experiment, self.folder / name / "vae"

    def _is_done(self, folder: Path, wanted: Experiment, parts: Sequence[str]) -> bool:
        if not (folder / MODEL / CARD_FILE).is_file():
            return False
        found = read_json(Run, folder / NAME)
        differing = [] if found.data == self.dataset.fingerprint else ["data"]
        for part in parts:
            one, other = _plain(getattr(found.experiment, part)), _plain(getattr(wanted, part))
            if one != other:
                differing += list(differing_keys(one, other, part))
        if differing:
            raise InputError(
                f"{folder} holds a run with other settings: {', '.join(differing)}; remove it, or "
                "use another output folder"
            )
        return True


def _plain(value: Any) -> Any:
    """Through text, as the run folder's went: tuples become lists."""
    return json.loads(json.dumps(to_json(value)))
