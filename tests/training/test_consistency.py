"""Phased consistency distillation: closed forms whose loss is zero, and training with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import torch

from latentmotion.condition import Conditioning
from latentmotion.data.dataset import Crop
from latentmotion.diffusion.parametrization import (
    Epsilon,
    Parametrization,
    ParametrizedDenoiser,
    Sample,
    Velocity,
)
from latentmotion.diffusion.schedule import (
    Cosine,
    LinearPath,
    ScaledLinear,
    Schedule,
    StepCondition,
)
from latentmotion.errors import ModelError
from latentmotion.model.card import ModelCard
from latentmotion.model.config import FewStepConfig
from latentmotion.networks.checkpoint import load_model, save_model
from latentmotion.training.denoiser import LatentCache, Posteriors
from latentmotion.training.denoiser_loss import between, step_loss
from latentmotion.training.distillation.data import PhasedConsistency
from latentmotion.training.distillation.stage import distill
from latentmotion.training.distillation.trajectories import PhaseSteps, Teacher
from latentmotion.training.experiment import TrainingSettings, with_changes
from latentmotion.training.stages import train_denoiser
from latentmotion.training.vae import BatchSampler
from tests.support.small_training import CONTEXT, killed_at, short_distillation, small

FEW_STEP = FewStepConfig(guidance=(1.0, 4.0), steps=(1, 2, 4), solver_steps=8)
ROWS, TOKENS, WIDTH = 64, 3, 2
MASK = torch.arange(TOKENS) < torch.tensor([3, 2])[torch.arange(ROWS) % 2, None]


@dataclass(frozen=True)
class Scaled:
    """The exact flow of latents N(0, 2²): it scales z by the deviations, s(b) / s(a), from a to b.

    Its answers are those with which one step of DDIM leads all the way, from a time of the solver's
    to the next for the teacher, to the end of its phase for the student; guidance doubles nothing.
    """

    schedule: Schedule
    parametrization: Parametrization
    wrong: float = 0.0

    def deviation(self, t: torch.Tensor) -> torch.Tensor:
        return ((2 * self.schedule.alpha(t)) ** 2 + self.schedule.sigma(t) ** 2) ** 0.5

    def leading(self, z: torch.Tensor, t: torch.Tensor, s: torch.Tensor) -> torch.Tensor:
        """The answer that leads from t to s; anything where that is no way at all."""
        end = z * (self.deviation(s) / self.deviation(t))[:, None, None]
        ends = between(z, end, t, torch.where(s == t, t - 1, s), self.schedule)
        return self.parametrization.target(*ends, t, self.schedule) + self.wrong

    def place(self, t: torch.Tensor) -> torch.Tensor:
        times = torch.from_numpy(self.schedule.timesteps(FEW_STEP.solver_steps))
        return (times[None] == t[:, None]).float().argmax(dim=1)

    def teacher(self, z: torch.Tensor, t: torch.Tensor, *_: Any) -> torch.Tensor:
        times = torch.from_numpy(self.schedule.timesteps(FEW_STEP.solver_steps))
        return self.leading(z, t, times[self.place(t) + 1])

    def student(
        self,
        z: torch.Tensor,
        t: torch.Tensor,
        condition: Any,
        mask: Any,
        step_condition: StepCondition,
    ) -> torch.Tensor:
        times = torch.from_numpy(self.schedule.timesteps(FEW_STEP.solver_steps))
        size = (FEW_STEP.solver_steps * step_condition.step_size).round().long()
        return self.leading(
            z, t, times[((self.place(t) // size + 1) * size).clamp(max=FEW_STEP.solver_steps)]
        )


def source(schedule: Schedule, teacher: Any, parametrization: Parametrization) -> PhaseSteps:
    """Phases of a teacher that knows no prompts, over latents N(0, 2²)."""
    nobody = Conditioning(torch.zeros(ROWS, 1, 1), torch.ones(ROWS, 1, dtype=torch.bool))
    mock = Mock(
        spec=Teacher,
        card=Mock(spec=ModelCard, schedule=schedule, parametrization=parametrization),
        few_step=FEW_STEP,
        prompts=lambda captions: nobody,
        guided=lambda scale: ParametrizedDenoiser(teacher, parametrization, schedule),
    )
    spread = torch.full((ROWS, TOKENS, WIDTH), 2.0)
    posteriors = Posteriors(0 * spread, spread, MASK)
    latents = Mock(spec=LatentCache, batch=lambda own, among: posteriors)
    batches = Mock(spec=BatchSampler, return_value=[Mock(spec=Crop, caption="")] * ROWS)
    return PhaseSteps(mock, batches, latents, TrainingSettings(batch_size=ROWS), CONTEXT)


@pytest.mark.parametrize("parametrization", [Epsilon(), Sample(), Velocity()])
@pytest.mark.parametrize("schedule", [ScaledLinear(), Cosine()])
def test_the_loss_of_the_exact_flow_is_zero(
    schedule: Schedule, parametrization: Parametrization
) -> None:
    exact = Scaled(schedule, parametrization)
    batch = source(schedule, exact.teacher, parametrization)(3, exact.student)
    scale = (exact.deviation(batch.times[1]) / exact.deviation(batch.times[0]))[:, None, None]
    assert torch.allclose(batch.end, batch.start * scale, atol=2e-3)
    assert not batch.end.requires_grad
    assert float(step_loss(exact.student, batch, schedule, Velocity(), 1.0)) >= 0
    assert float(step_loss(exact.student, batch, schedule, parametrization, 1.0)) < 1e-5
    wrong = replace(exact, wrong=0.5)
    assert float(step_loss(wrong.student, batch, schedule, parametrization, 1.0)) > 0.01


@pytest.mark.parametrize("parametrization", [Sample(), Velocity()])
def test_the_loss_of_the_exact_straight_flow_is_zero(parametrization: Parametrization) -> None:
    # Where there is no signal, at t = 1, noise says nothing of latents: no such model can be.
    test_the_loss_of_the_exact_flow_is_zero(LinearPath(), parametrization)


def test_phases_begin_in_noise_and_are_never_left() -> None:
    exact = Scaled(LinearPath(), Velocity())
    batch = source(LinearPath(), exact.teacher, Velocity())(0, exact.student)
    t, s = batch.times
    steps = (1 / batch.step_condition.step_size).round()
    assert (t > s).all() and set(steps.tolist()) == {1.0, 2.0, 4.0}
    # The next end of a phase below t is s, for each number of steps.
    torch.testing.assert_close((torch.ceil(t * steps - 1e-4) - 1) / steps, s)
    least, most = (
        float(batch.step_condition.guidance.min()),
        float(batch.step_condition.guidance.max()),
    )
    assert 1.0 <= least < 1.3 and 3.7 < most <= 4.0
    deviation = batch.start[(t == 1.0)[:, None] & MASK].std()
    assert float(deviation) == pytest.approx(1.0, abs=0.2)


def test_the_average_is_asked_at_the_end_of_the_teachers_step() -> None:
    exact, asked = Scaled(LinearPath(), Velocity()), []

    def average(z, t, condition, mask, step_condition):  # type: ignore[no-untyped-def]
        asked.append(t)
        return exact.student(z, t, condition, mask, step_condition) + 1.0

    batch = source(LinearPath(), exact.teacher, Velocity())(0, average)
    torch.testing.assert_close(asked[0], batch.times[0] - 1 / FEW_STEP.solver_steps)
    scale = exact.deviation(batch.times[1]) / exact.deviation(batch.times[0])
    moved = batch.end - batch.start * scale[:, None, None]
    # A velocity wrong by 1 over the rest of the phase, and nothing where there is no rest.
    expected = (batch.times[1] - asked[0])[:, None, None].expand_as(moved)
    torch.testing.assert_close(moved, expected, atol=1e-5, rtol=0)


# Training

SETTINGS = short_distillation(
    FEW_STEP, PhasedConsistency(per_item=2), report_every=8, validate_every=8, sample_every=0
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


def test_it_goes_on_bit_for_bit(
    student: Path, figures: Path, teacher: Path, tmp_path: Path
) -> None:
    with killed_at(5):
        distill(SETTINGS, figures, teacher, None, tmp_path / "run", CONTEXT)
    found = distill(SETTINGS, figures, teacher, None, tmp_path / "run", CONTEXT)
    one, other = (folder / "weights.safetensors" for folder in (student, found))
    assert one.read_bytes() == other.read_bytes()


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
