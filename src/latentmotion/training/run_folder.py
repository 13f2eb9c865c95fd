"""A run folder keeps what it was made with; going on with anything else is an error."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from latentmotion.errors import InputError
from latentmotion.experiment import Experiment, differing_keys
from latentmotion.model.card import CARD_FILE
from latentmotion.storage.configuration import read_json, to_json, write_json
from latentmotion.training.devices import Place

NAME = "experiment.json"

_OTHERS = ("manifest.json", CARD_FILE, "evaluator.json", "report.json")
"""What other folders of this package have."""

MODEL = "model"
"""Where in a run folder the trained model is put."""


@dataclass(frozen=True)
class Run:
    """What a run folder was made with."""

    stage: str
    """`vae` or `denoiser`."""
    data: str
    """Fingerprint of the prepared data."""
    parents: dict[str, str]
    """Fingerprints of what the run builds on: the VAE, the text encoder."""
    experiment: Experiment
    """Everything else that decides what the run yields."""


def open_run(folder: Path, run: Any, place: Place) -> None:
    """Makes the folder, or checks that it was made with the same.

    Args:
        folder: The run folder.
        run: A `Run`, or another frozen dataclass that says all that decides what the run yields.
        place: The leading rank makes it.

    Raises:
        InputError: It was made with something else (the differing keys are named), or it cannot be
            written.
    """
    path = folder / NAME
    if path.exists():
        _check_same(path, run)
    elif place.leads:
        _check_free(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot make the run folder {folder}: {error.strerror}") from error
        write_json(path, run)
    place.wait()


def _check_free(folder: Path) -> None:
    found = next((name for name in _OTHERS if (folder / name).is_file()), None)
    if found:
        raise InputError(
            f"{folder} holds data or a model ({found}), no run; choose another folder to train in"
        )


def _check_same(path: Path, run: Any) -> None:
    # Through text, as the file went: tuples become lists.
    found = json.loads(json.dumps(to_json(read_json(type(run), path))))
    wanted = json.loads(json.dumps(to_json(run)))
    differing = list(differing_keys(found, wanted))
    if differing:
        raise InputError(
            f"{path.parent} holds a run with another configuration; differing: "
            f"{', '.join(differing)}; use the same, or another folder"
        )
