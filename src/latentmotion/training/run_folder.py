"""Run folders: the settings of a run, checked when it is resumed, and the cards of its models."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from latentmotion.condition.task import TASKS
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.gpu.device import describe_machine
from latentmotion.model.card import CARD_FILE, ModelCard, Provenance
from latentmotion.storage.configuration import from_json, read_plain, to_json, write_json
from latentmotion.storage.provenance import command_line, commit
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import Experiment, differing_keys
from latentmotion.training.task_conditions import TaskConditioning


def provenance_of(dataset: Dataset, seconds: float, before: Provenance | None = None) -> Provenance:
    """Says what the running command makes a model from.

    Args:
        dataset: Training data.
        seconds: Duration of the training.
        before: Provenance of the model that it builds on.
    """
    sources, before = dataset.sources, before or Provenance()
    hashes = {f"{dataset.folder.name}/manifest.json": dataset.fingerprint}
    return replace(
        before,
        data=tuple(f"{source.name}: {source.credit}" for source in sources),
        data_hashes={**before.data_hashes, **hashes},
        license="; ".join(dict.fromkeys(source.license for source in sources)) or "unknown",
        commands=(*before.commands, command_line()),
        commit=commit(),
        machine=describe_machine(),
        hours=round(before.hours + seconds / 3600, 3),
    )


NAME = "experiment.json"

FORMAT = 2
"""Version of experiment.json that this code writes and reads."""

AnyRun = TypeVar("AnyRun")

# Files of other folders of this package.
_OTHERS = ("manifest.json", CARD_FILE, "evaluator.json", "report.json")

_STEPS = re.compile(r"(?:\w+\.)*\w*training\.steps \((\d+) → (\d+)\)")
# Settings that may differ when a run is resumed.
_MACHINE = re.compile(r"(?:\w+\.)*\w*training\.(?:precision|parallel) \(.*\)")

MODEL = "model"
"""Folder of the trained model in a run folder."""


@dataclass(frozen=True)
class Run:
    """Settings that a run folder was made with."""

    stage: str
    """`vae` or `denoiser`."""
    data: str
    """Fingerprint of the prepared data."""
    parents: dict[str, str]
    """Fingerprints of what the run builds on: the VAE, the text encoder."""
    experiment: Experiment
    """Everything else that decides what the run yields."""


def open_run(folder: Path, run: Any, context: DistributedContext) -> None:
    """Makes the folder, or checks that it was made with the same.

    With more steps than before a finished run goes on; the precision and the way in which ranks
    share the work may be others, too.

    Args:
        folder: The run folder.
        run: A `Run`, or another frozen dataclass that says all that decides what the run yields.
        context: The leading rank makes it.

    Raises:
        InputError: It was made with something else (the differing keys are named), or it cannot be
            written.
    """
    path = folder / NAME
    if path.exists():
        # Through text, as the file went: tuples become lists.
        existing = json.loads(json.dumps(to_json(read_run(type(run), folder))))
        current = json.loads(json.dumps(to_json(run)))
        differing = list(differing_keys(existing, current))
        fixed = []
        for key in differing:  # more steps and another precision may be asked for
            steps = _STEPS.fullmatch(key)
            more = steps and int(steps[2]) > int(steps[1])
            if not more and not _MACHINE.fullmatch(key):
                fixed.append(key)
        if fixed:
            raise InputError(
                f"{folder} holds a run with another configuration; differing: "
                f"{', '.join(fixed)}; use the same, or another folder"
            )
        if differing and context.is_main:
            write_json(path, {"format": FORMAT, **to_json(run)})
    elif context.is_main:
        other = next((name for name in _OTHERS if (folder / name).is_file()), None)
        if other:
            raise InputError(
                f"{folder} holds data or a model ({other}); choose another folder to train in"
            )
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the run folder {folder}: {error.strerror}") from error
        write_json(path, {"format": FORMAT, **to_json(run)})
    context.wait()


def read_run(cls: type[AnyRun], folder: Path) -> AnyRun:
    """Reads what a run folder was made with.

    Raises:
        InputError: There is none, it is damaged, or it is of another version.
    """
    path = folder / NAME
    data = read_plain(path)
    version = data.pop("format", None) if isinstance(data, dict) else FORMAT
    if version != FORMAT:
        raise InputError(f"{path}: format {version}, expected {FORMAT}; update latentmotion")
    try:
        return from_json(cls, data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


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
