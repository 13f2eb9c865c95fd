"""The starter's experiment, small enough to train in a second."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from latentmotion.diffusion.condition import TextEmbedding
from latentmotion.model.config import FewStepConfig
from latentmotion.training import loop
from latentmotion.training.distillation.data import (
    Distillation,
    TrajectoryRegression,
)
from latentmotion.training.distributed import DistributedContext, Ranks
from latentmotion.training.experiment import Experiment, preset_named, with_changes

CONTEXT = DistributedContext(torch.device("cpu"), Ranks())

# The starter, small enough to train in a second.
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


@dataclass(frozen=True)
class LetterCount:
    """A text encoder of six numbers."""

    name: str = "letter-count"
    width: int = 6

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        rows = [[sentence.count(letter) for letter in "aeiour"] for sentence in sentences]
        pooled = np.asarray(rows, np.float32)
        return TextEmbedding(pooled, pooled[:, None], np.ones((len(rows), 1), bool))


def small(**changes: object) -> Experiment:
    every = {**CHANGES, **changes}
    return with_changes(preset_named("starter"), [f"{k}={json.dumps(v)}" for k, v in every.items()])


def short_distillation(
    few_step: FewStepConfig, objective: TrajectoryRegression, **changes: int
) -> Distillation:
    """Returns a distillation of a second."""
    training = {"steps": 8, "batch_size": 8, "precision": "float32", "snapshot_every": 2, **changes}
    settings = Distillation(few_step=few_step, objective=objective)
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
