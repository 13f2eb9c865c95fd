"""Distillation to few steps: leaps in closed form, training, and what a student may be asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Crop, Dataset, Item
from latentmotion.data.instructions import instructions
from latentmotion.diffusion.condition import ActionTask, Conditioning, TextEmbedding
from latentmotion.diffusion.guidance import ClassifierFreeGuidance, DistilledGuidance
from latentmotion.diffusion.parametrization import Epsilon, Sample, Velocity
from latentmotion.diffusion.samplers import DDIM
from latentmotion.diffusion.schedule import (
    Cosine,
    FewStepSchedule,
    LinearPath,
    ScaledLinear,
    Schedule,
    StepCondition,
)
from latentmotion.errors import InputError, ModelError
from latentmotion.model.config import DenoiserConfig, FewStepConfig, TransformerConfig
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import FirstStageModel, build, load_model, save_model
from latentmotion.training.denoiser_loss import StepBatch, between, step_loss
from latentmotion.training.distillation.data import TrajectoryRegression, reworded_crops
from latentmotion.training.distillation.stage import distill, student_of
from latentmotion.training.distillation.trajectories import (
    TRAJECTORIES_FILE,
    PromptedTrajectories,
    Teacher,
    Trajectories,
    check_stops,
)
from latentmotion.training.experiment import with_changes
from latentmotion.training.stages import train_denoiser
from latentmotion.training.task_conditions import ConditionTable
from tests.support.small_training import CONTEXT, killed_at, short_distillation, small

SCHEDULES = [ScaledLinear(), Cosine(), LinearPath()]
FEW_STEP = FewStepConfig(guidance=(1.0, 4.0), steps=(1, 2, 4), solver_steps=8)
SETTINGS = short_distillation(
    FEW_STEP,
    TrajectoryRegression(trajectories=64),
    report_every=1,
    validate_every=4,
    sample_every=8,
)


# Wordings


def test_verbs_are_reworded_evenly_and_no_benchmark_prompt_is_learned() -> None:
    clip = Clip("a", "own", "train", (), None, False, 40)
    texts = ["a person jumps up and lands"] * 90 + ["someone kneels down"] * 8 + ["a man rows"] * 3
    items = [Item(clip, 0, 40, (text,)) for text in texts]
    settings = replace(SETTINGS, objective=TrajectoryRegression(reworded=200, wordings=3))
    found = reworded_crops(settings, items)
    asked = [crop.caption for crop, _ in found]
    assert set(asked) == set(texts[:98])
    assert abs(asked.count(texts[0]) - asked.count(texts[90])) <= len(asked) / 3
    assert {len(wordings) for _, wordings in found} <= {1, 2, 3}
    assert all(crop.caption not in wordings for crop, wordings in found)
    read = {text for _, wordings in found for text in wordings}
    assert not read & {one.prompt for one in instructions()}
    assert reworded_crops(SETTINGS, items) == ()


def test_wordings_of_a_caption_take_turns() -> None:
    clip = Clip("a", "own", "train", (), None, False, 40)
    crops = tuple(Crop(clip, 0, 40, text) for text in ("kneel", "row", "hop"))
    trajectories = Trajectories(
        torch.zeros(3, 1, 1, 1), torch.ones(3, 1) > 0, torch.ones(3), torch.arange(3)
    )
    data = PromptedTrajectories(crops, trajectories, {crops[1]: ("paddle", "scull")})
    read = [data.captions(range(3), step, batch=3) for step in range(3)]
    assert read == [["kneel", text, "hop"] for text in ("paddle", "scull", "paddle")]


# FewStepConfig


def test_stops_are_where_leaps_begin_and_end() -> None:
    assert FEW_STEP.stops == [0, 2, 4, 6, 8]
    assert FewStepConfig(steps=(1, 3), solver_steps=3).stops == [0, 1, 2, 3]


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_leaps_stop_over_at_the_solvers_times(schedule: Schedule) -> None:
    every = schedule.timesteps(8).tolist()
    for steps in (1, 2, 4):
        times = FewStepSchedule(schedule, FEW_STEP.solver_steps).timesteps(steps).tolist()
        assert times == every[:: 8 // steps] and len(times) == steps + 1
    assert isinstance(FewStepSchedule(schedule, FEW_STEP.solver_steps), Schedule)


def test_leaps_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match="3; expected divisors"):
        FewStepConfig(steps=(1, 3))
    with pytest.raises(InputError, match="none; expected"):
        FewStepConfig(steps=())
    with pytest.raises(InputError, match="smaller scale first"):
        FewStepConfig(guidance=(5.0, 1.0))


@pytest.mark.parametrize("parametrization", [Epsilon(), Sample(), Velocity()])
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_ddim_makes_the_leap_between_two_points(schedule, parametrization) -> None:  # type: ignore[no-untyped-def]
    generator = torch.Generator().manual_seed(0)
    start, end = (torch.randn(3, 5, 4, generator=generator) for _ in range(2))
    t, s = (torch.full((3,), float(time)) for time in schedule.timesteps(8)[[2, 6]])
    answer = parametrization.target(*between(start, end, t, s, schedule), t, schedule)
    times = float(t[0]), float(s[0])
    estimates = parametrization.to_x0_eps(answer, start, times[0], schedule)
    stepped = DDIM(schedule).step(estimates, start, *times, np.zeros)
    assert torch.allclose(stepped, end, atol=2e-4)


def test_the_loss_of_the_teachers_own_velocity_is_zero() -> None:
    start, end = torch.randn(2, 5, 4), torch.randn(2, 5, 4)
    times = torch.tensor([1.0, 0.5]), torch.tensor([0.5, 0.0])
    mask = torch.tensor([[True] * 5, [True, True, False, False, False]])
    end = torch.where(mask[..., None], end, start)
    exact = (end - start) / (times[1] - times[0])[:, None, None]

    def loss(answer: torch.Tensor) -> float:
        student = lambda *_: answer  # noqa: E731
        nobody = Conditioning(torch.zeros(2, 1, 1), mask[:, :1])
        step_condition = StepCondition(torch.ones(2), torch.ones(2))
        batch = StepBatch(start, end, times, nobody, mask, step_condition)
        return float(step_loss(student, batch, LinearPath(), Velocity(), huber_delta=10.0))

    assert loss(exact) < 1e-10
    assert loss(exact + 0.2) == pytest.approx(0.2**2 / 2, rel=1e-4)


def test_guidance_is_told_not_computed() -> None:
    calls = []

    def student(z, t, condition, mask, step_condition):  # type: ignore[no-untyped-def]
        calls.append(step_condition)
        return z

    z, t, mask = np.zeros((2, 3, 4), np.float32), np.ones(2, np.float32), np.ones((2, 3), bool)
    nobody = Conditioning(np.zeros((2, 1, 2), np.float32), np.ones((2, 1), bool))
    DistilledGuidance(student, 3.5, 4)(z, t, nobody, mask)
    assert calls[0].guidance.tolist() == [3.5, 3.5] and calls[0].step_size.tolist() == [0.25, 0.25]
    assert calls[0].guidance.dtype == np.float32


def test_each_row_is_guided_by_its_own_scale() -> None:
    def network(z, t, condition, mask):  # type: ignore[no-untyped-def]
        return z + condition.tokens[:, :1]

    z, t, mask = torch.zeros(2, 3, 1), torch.ones(2), torch.ones(2, 3, dtype=torch.bool)
    real = torch.ones(2, 1, dtype=torch.bool)
    null, seen = (
        Conditioning(torch.zeros(1, 1, 1), real[:1]),
        Conditioning(mask[:, :1, None] * 2.0, real),
    )
    found = ClassifierFreeGuidance(network, null, torch.tensor([1.0, 5.0]))(z, t, seen, mask)
    assert found[:, 0, 0].tolist() == [2.0, 10.0]


def test_a_student_starts_as_its_teacher_whatever_it_is_told() -> None:
    shape = TransformerConfig(width=16, layers=3, heads=2, hidden=16, dropout=0.0)
    config = DenoiserConfig(latent_width=4, condition_width=6, transformer=shape, length_token=True)
    teacher = build(config).eval()
    student = student_of(teacher, replace(config, few_step=FEW_STEP)).eval()
    z, t, mask = torch.randn(2, 5, 4), torch.rand(2), torch.ones(2, 5, dtype=torch.bool)
    seen = Conditioning(torch.randn(2, 3, 6), torch.ones(2, 3, dtype=torch.bool))
    step_condition = StepCondition(torch.tensor([1.0, 4.0]), torch.tensor([1.0, 0.25]))
    with torch.no_grad():
        assert torch.equal(teacher(z, t, seen, mask), student(z, t, seen, mask, step_condition))


# Training


@pytest.fixture(scope="module")
def teacher(unconditional_run: Path) -> Path:
    return unconditional_run


@pytest.fixture(scope="module")
def student(figures: Path, teacher: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("student") / "run"
    return distill(SETTINGS, figures, teacher, None, run, CONTEXT)


def test_a_student_is_a_model_like_any_other(student: Path, teacher: Path) -> None:
    card, before = load_model(student).card, load_model(teacher / "model").card
    assert card.few_step == FEW_STEP and before.few_step is None
    assert (card.sampling.steps, card.sampling.sampler, card.task) == (4, "ddim", "unconditional")
    assert card.latents == before.latents and card.vae == before.vae
    assert {"student_rms_of_1", "student_rms_of_4", "teacher"} <= set(card.figures)
    assert len(card.provenance.commands) == 3
    assert list(student.parent.glob("samples-*.png"))


class AnotherEncoder:
    """A text encoder that nobody asks."""

    name, width = "another", 6

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        raise AssertionError(sentences)


def test_it_goes_on_bit_for_bit(
    student: Path, figures: Path, teacher: Path, tmp_path: Path
) -> None:
    with killed_at(5):
        distill(SETTINGS, figures, teacher, None, tmp_path / "run", CONTEXT)
    found = distill(SETTINGS, figures, teacher, None, tmp_path / "run", CONTEXT)
    one, other = (folder / "weights.safetensors" for folder in (student, found))
    assert one.read_bytes() == other.read_bytes()
    with pytest.raises(InputError, match=r"settings.huber_delta \(1.0 → 2.0\)"):
        distill(
            replace(SETTINGS, huber_delta=2.0), figures, teacher, None, tmp_path / "run", CONTEXT
        )
    with pytest.raises(InputError, match=r"differing: text"):
        distill(SETTINGS, figures, teacher, AnotherEncoder(), tmp_path / "run", CONTEXT)


def test_ways_are_gone_by_the_solver_that_is_named(
    figures: Path, teacher: Path, tmp_path: Path
) -> None:
    ways = []
    for solver in ("dpm++", "ddim"):
        settings = with_changes(SETTINGS, [f"solver={solver}", "training.steps=1"])
        distill(settings, figures, teacher, None, tmp_path / solver, CONTEXT)
        ways.append(load_file(tmp_path / solver / TRAJECTORIES_FILE)["points"])
    assert torch.equal(ways[0][:, 0], ways[1][:, 0])
    assert not torch.allclose(ways[0][:, -1], ways[1][:, -1])
    with pytest.raises(InputError, match="solver"):
        with_changes(SETTINGS, ["solver=heun"])


def test_an_earlier_student_has_nothing_to_learn_from_its_own_steps(
    student: Path, figures: Path
) -> None:
    model, device = load_model(student), torch.device("cpu")
    model.denoiser.eval()
    prompts = ConditionTable(model.card.prompt_condition(lambda: None), [], device)  # type: ignore[arg-type]
    former = Teacher(model.denoiser, model.card, FEW_STEP, prompts, device, "dpm++")
    clip = next(iter(Dataset.load(figures).clips("train")))
    found = former.trajectories([Crop(clip, 0, frames, "") for frames in (24, 40)], 3)
    assert found.points.shape[1] == 5
    schedule = FewStepSchedule(model.card.schedule, FEW_STEP.solver_steps)
    times = torch.from_numpy(schedule.timesteps(4)).float()
    for step in range(4):
        with torch.no_grad():
            batch = StepBatch(
                start=found.points[:, step],
                end=found.points[:, step + 1],
                times=(times[step].expand(2), times[step + 1].expand(2)),
                condition=prompts(["", ""]),
                mask=found.mask,
                step_condition=StepCondition(found.guidance, torch.full((2,), 0.25)),
            )
            answers = model.card.schedule, model.card.parametrization, 1.0
            assert float(step_loss(model.denoiser, batch, *answers)) < 1e-8


def test_steps_that_end_elsewhere_are_refused(student: Path, teacher: Path) -> None:
    own = load_model(student).card
    for card in (own, load_model(teacher / "model").card):
        check_stops(card, FEW_STEP)
    with pytest.raises(InputError, match=r"makes 4 steps, which do not end where .* \[8\] do"):
        check_stops(own, replace(FEW_STEP, steps=(8,)))


def test_training_brings_leaps_nearer_to_the_teachers(
    figures: Path, teacher: Path, tmp_path: Path
) -> None:
    model = load_model(teacher / "model")
    with torch.no_grad():  # so small a network goes all but straight; this makes it bend
        for weight in model.denoiser.latents_out.parameters():
            weight.mul_(4.0)
    save_model(tmp_path / "bent", model)

    def figures_after(steps: int) -> dict[str, float]:
        changes = [f"training.steps={steps}", "training.warm_up=2", "training.sample_every=0"]
        settings = with_changes(SETTINGS, [*changes, "training.snapshot_every=100"])
        run = tmp_path / str(steps)
        return load_model(
            distill(settings, figures, tmp_path / "bent", None, run, CONTEXT)
        ).card.figures

    found, first = figures_after(40), figures_after(1)
    # A quarter of the way is straight enough to begin with.
    for name in ("student_rms_of_1", "student_rms_of_2"):
        assert found[name] < 0.95 * first[name], name


def test_what_it_has_not_learned_is_refused(student: Path) -> None:
    generator = torch_pipeline(student)
    for message, asked in {
        "3 sampling steps: this distilled model takes 1, 2, 4": {"steps": 3},
        "guidance 7: this distilled model learned 1 to 4": {"guidance": 7.0},
        "sampler heun: a distilled model": {"sampler": "heun"},
    }.items():
        with pytest.raises(InputError, match=message):
            generator("", **asked)  # type: ignore[arg-type]


def test_who_cannot_teach_is_refused(
    figures: Path, teacher: Path, student: Path, tmp_path: Path
) -> None:
    with pytest.raises(ModelError, match="is distilled already"):
        distill(SETTINGS, figures, student, None, tmp_path / "a", CONTEXT)
    model = load_model(teacher / "model")
    save_model(tmp_path / "vae", FirstStageModel(replace(model.card, denoiser=None), model.vae))
    with pytest.raises(ModelError, match="train both stages first"):
        distill(SETTINGS, figures, tmp_path / "vae", None, tmp_path / "b", CONTEXT)


def test_what_it_cannot_be_asked_is_refused(figures: Path, teacher: Path, tmp_path: Path) -> None:
    short = with_changes(SETTINGS, ["cropping.max_frames=4", "cropping.min_frames=4"])
    with pytest.raises(InputError, match=r"makes 12 to 196 frames, cropping asks for 4 to 4"):
        distill(short, figures, teacher, None, tmp_path / "a", CONTEXT)
    model = load_model(teacher / "model")
    condition = ActionTask(("fly", "swim"))
    card = replace(model.card, condition=condition)
    save_model(tmp_path / "birds", replace(model, card=card))
    with pytest.raises(InputError, match=r"no training clip .* that model 'starter' knows"):
        distill(SETTINGS, figures, tmp_path / "birds", None, tmp_path / "b", CONTEXT)


def test_raw_frames_have_students_too(figures: Path, tmp_path: Path) -> None:
    experiment = small(
        task="unconditional",
        **{
            "denoiser.latent_width": 263,
            "latents.normalized": False,
            "denoiser_objective.schedule": {"kind": "Cosine", "length": 50},
            "denoiser_objective.parametrization": {"kind": "Sample"},
        },
    )
    train_denoiser(experiment, figures, None, None, tmp_path / "mdm", CONTEXT)
    found = distill(SETTINGS, figures, tmp_path / "mdm", None, tmp_path / "run", CONTEXT)
    assert len(torch_pipeline(found).features([""], [20], [0], steps=2)[0]) == 20
