"""The starter's experiment, small enough to train in a second."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from latentmotion.diffusion.leaps import Leaps
from latentmotion.distillation import Distillation, PhasedConsistency, Regression
from latentmotion.experiment import Experiment, with_changes
from latentmotion.presets import PRESETS
from latentmotion.training import loop

CHANGES = {
    "vae.width": 16,
    "vae.channels": 4,
    "vae.dilations": [1],
    "vae_cropping.max_frames": 24,
    "denoiser.latent_width": 4,
    "denoiser.condition_width": 6,
    "denoiser.transformer": {"width": 16, "layers": 3, "heads": 2, "hidden": 16, "dropout": 0.1},
    "latents.per_item": 2,
    **{
        f"{stage}_training.{key}": value
        for stage in ("vae", "denoiser")
        for key, value in {
            "steps": 8,
            "batch_size": 4,
            "warm_up": 2,
            "precision": "float32",
            "report_every": 1,
            "validate_every": 4,
            "snapshot_every": 2,
            "sample_every": 0,
        }.items()
    },
}
"""The starter, small enough to train in a second."""


def small(**changes: object) -> Experiment:
    every = {**CHANGES, **changes}
    return with_changes(PRESETS["starter"](), [f"{k}={json.dumps(v)}" for k, v in every.items()])


def short_distillation(
    leaps: Leaps, objective: Regression | PhasedConsistency, **changes: int
) -> Distillation:
    """Returns a distillation of a second."""
    training = {"steps": 8, "batch_size": 8, "precision": "float32", "snapshot_every": 2, **changes}
    settings = Distillation(leaps=leaps, objective=objective)
    return with_changes(settings, [f"training.{key}={value}" for key, value in training.items()])


@contextmanager
def killed_at(step: int) -> Iterator[None]:
    """Kills the training inside as it comes to this step."""
    optimize = loop.optimize

    def stop(*arguments: object) -> object:
        if arguments[3] == step:
            raise KeyboardInterrupt
        return optimize(*arguments)  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(loop, "optimize", stop)
        yield
