"""Distillation of a teacher without prompts that predicts noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from latentmotion.diffusion.parametrization import (
    Epsilon,
    Velocity,
)
from latentmotion.diffusion.schedule import (
    ScaledLinear,
)
from latentmotion.errors import ModelError
from latentmotion.model.config import FewStepConfig
from latentmotion.networks.checkpoint import load_model, save_model
from latentmotion.training.distillation.data import TrajectoryRegression
from latentmotion.training.distillation.stage import distill
from latentmotion.training.experiment import with_changes
from latentmotion.training.stages import train_denoiser
from tests.support.small_training import CONTEXT, short_distillation, small

FEW_STEP = FewStepConfig(guidance=(1.0, 4.0), steps=(1, 2, 4), solver_steps=8)
SETTINGS = short_distillation(
    FEW_STEP,
    TrajectoryRegression(trajectories=64),
    report_every=8,
    validate_every=8,
    sample_every=0,
)


@pytest.fixture(scope="module")
def teacher(figures: Path, vae_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A teacher of the paper's schedule and parametrization, of noise."""
    folder = tmp_path_factory.mktemp("runs") / "denoiser"
    kinds = {"schedule": {"kind": "ScaledLinear"}, "parametrization": {"kind": "Epsilon"}}
    objective = {f"denoiser_objective.{name}": kind for name, kind in kinds.items()}
    experiment = small(task="unconditional", **objective)
    return train_denoiser(experiment, figures, vae_run, None, folder, CONTEXT)


@pytest.fixture(scope="module")
def student(figures: Path, teacher: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("student") / "run"
    return distill(SETTINGS, figures, teacher, None, run, CONTEXT)


def test_a_student_of_noise_answers_with_noise(student: Path, teacher: Path) -> None:
    card, before = load_model(student).card, load_model(teacher).card
    assert card.few_step == FEW_STEP and card.frames == (12, before.frames[1])
    assert (
        card.parametrization == before.parametrization == Epsilon()
        and card.schedule == ScaledLinear()
    )
    assert {"student_rms_of_1", "student_rms_of_2", "student_rms_of_4"} <= set(card.figures)


def test_every_weight_is_trained(student: Path, teacher: Path) -> None:
    before, after = load_model(teacher).denoiser, load_model(student).denoiser
    assert before is not None and after is not None
    weights = before.state_dict()
    for name, weight in after.named_parameters():
        first = weights.get(name, torch.zeros_like(weight))
        # A model without prompts sees no words, whose weights stay what they are.
        assert torch.equal(weight, first) == name.startswith("condition_in"), name


def test_another_student_can_be_begun_as(
    student: Path, figures: Path, teacher: Path, tmp_path: Path
) -> None:
    changes = ["training.steps=1", "training.learning_rate=0", "few_step.steps=[1,2]"]
    found = distill(
        with_changes(SETTINGS, changes), figures, teacher, None, tmp_path / "run", CONTEXT, student
    )
    before, after = (load_model(folder).card.provenance for folder in (student, found))
    assert after.commands[:-1] == before.commands and len(after.commands) == 4
    one, other = load_model(student).denoiser, load_model(found).denoiser
    assert one is not None and other is not None
    for name, weight in one.state_dict().items():
        assert torch.equal(weight, other.state_dict()[name]), name
    with pytest.raises(ModelError, match="is not distilled"):
        distill(SETTINGS, figures, teacher, None, tmp_path / "a", CONTEXT, teacher)
    card = replace(load_model(student).card, parametrization=Velocity())
    save_model(tmp_path / "other", replace(load_model(student), card=card))
    with pytest.raises(ModelError, match=r"parametrization Velocity\(\), expected Epsilon\(\)"):
        distill(SETTINGS, figures, teacher, None, tmp_path / "b", CONTEXT, tmp_path / "other")
