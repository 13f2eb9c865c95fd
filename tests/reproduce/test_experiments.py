from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.quality.strips import draw_strips
from benchmarks.training.curves import (
    CurveRunner,
    Curves,
    Point,
    last_fall,
    over_clips,
)
from latentmotion.cli.main import main
from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError, InputError, named
from latentmotion.evaluation.evaluators.interface import Recognition
from latentmotion.evaluation.protocol import CLEAN, Repeats
from latentmotion.model.config import TransformerVAEConfig
from latentmotion.networks.checkpoint import build
from latentmotion.reproduce.budget import BUDGETS, MODELS, PAPER, SMALL, Budget, Model
from latentmotion.reproduce.markdown import (
    RowResult,
    TableResult,
    cell,
    markdown,
    minutes,
    overview,
    rows_of,
)
from latentmotion.reproduce.plots import chosen, map_of, silhouette
from latentmotion.reproduce.runner import TableRunner
from latentmotion.reproduce.table import TABLES, Row, Table, rows_named
from latentmotion.reproduce.workspace import Workspace
from latentmotion.storage.configuration import read_json
from tests.support.moving_figures import write_moving_figures
from tests.support.small_training import CONTEXT, LetterCount

TINY = replace(
    SMALL,
    name="tiny",
    width=16,
    layers={6: 3, 8: 3, 9: 3, 15: 3},
    max_frames=32,
    replications=2,
).changed(
    [
        "vae_cropping.max_frames=32",
        "latents.cropping.max_frames=32",
        "sampling.steps=3",
        *(
            f"{stage}_training.{setting}"
            for stage in ("vae", "denoiser")
            for setting in ("steps=4", "batch_size=4", "report_every=1", "validate_every=2")
        ),
    ]
)
TINY_ACTIONS = replace(TINY, max_frames=None).changed(
    ["vae_cropping.max_frames=60", "latents.cropping.max_frames=60"]
)
PROTOCOL = replace(
    CLEAN,
    split="val",
    group=2,
    replications=2,
    repeats=Repeats(texts=2, samples=2, replications=1),
)


@dataclass(frozen=True)
class Means:
    """A text-motion evaluator: a few mean features, and letters of captions."""

    width: int = 6
    fingerprint: str = "means"

    def motions(self, features: Sequence[np.ndarray]) -> np.ndarray:
        return np.stack([motion[:, :6].mean(axis=0) for motion in features])

    def texts(self, captions: Sequence[Caption]) -> np.ndarray:
        return LetterCount()([caption.text for caption in captions]).pooled


@dataclass(frozen=True)
class Guesses:
    """An action classifier that knows nothing."""

    labels: tuple[str, ...]
    fingerprint: str = "guesses"

    def __call__(self, features: Sequence[np.ndarray]) -> Recognition:
        vectors = np.stack([motion[:, :6].mean(axis=0) for motion in features])
        return Recognition(vectors, vectors[:, : len(self.labels)])


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("data") / "figures"
    return Dataset.load(write_moving_figures(folder, train=8, val=6))


def workspace_of(dataset: Dataset, folder: Path, told: list[str]) -> Workspace:
    return Workspace(dataset, folder, TINY, CONTEXT, lambda _: LetterCount(), tell=told.append)


def test_every_row_has_a_model_and_every_model_a_row() -> None:
    models = {row.model for table in TABLES.values() for row in table.rows if row.model}
    assert models == set(MODELS)
    assert all(model.first in ("", *MODELS) for model in MODELS.values())
    for table in TABLES.values():
        names = [row.name for row in table.rows]
        assert len(names) == len(set(names)), table.name


def test_every_figure_of_the_papers_arxiv_version_is_stated() -> None:
    unstated = {
        (table.name, metric)
        for table in TABLES.values()
        for row in table.rows
        for metric, figure in row.paper.items()
        if figure is None
    }
    tables_9_and_10 = {"R@3", "MM-Dist", "Diversity"}, {"FID", "Time of 2,048", "GFLOPs"}
    wanted = zip(("prediction", "steps"), tables_9_and_10, strict=True)
    assert unstated == {(table, metric) for table, metrics in wanted for metric in metrics}


@pytest.mark.parametrize("budget", [PAPER, SMALL])
@pytest.mark.parametrize("name", [name for name, m in MODELS.items() if not m.shipped])
def test_every_model_can_be_built(name: str, budget: Budget) -> None:
    model = MODELS[name]
    first = MODELS[model.first or name].first_stage(budget, 263)
    second = model.second_stage(first, budget, 263, 384)
    assert second.task == model.task and second.denoiser.condition_width == 384
    assert model.raw or second.vae == first.vae
    if budget is SMALL:
        vae, denoiser = build(first.vae), build(second.denoiser)
        wanted = 263 if model.raw else vae.latent_width
        assert second.denoiser.latent_width == wanted and denoiser is not None


def values_of(settings: Any) -> Any:
    """Values of settings without their names, which may change; variants by class or values."""
    if is_dataclass(settings):
        return [values_of(getattr(settings, f.name)) for f in fields(settings)] or type(
            settings
        ).__name__
    return [values_of(item) for item in settings] if isinstance(settings, tuple) else settings


def digest_of(name: str, budget: Budget) -> str:
    model = MODELS[name]
    first = MODELS[model.first or name].first_stage(budget, 263)
    second = model.second_stage(first, budget, 263, 384)
    text = json.dumps([values_of(first), values_of(second)])
    return hashlib.sha256(text.encode()).hexdigest()[:8]


@pytest.mark.parametrize("budget", ["paper", "small"])
def test_every_model_keeps_its_settings(budget: str) -> None:
    pinned = json.loads((Path(__file__).parent / "experiments.json").read_text())[budget]
    trained = [name for name, model in MODELS.items() if not model.shipped]
    assert {name: digest_of(name, BUDGETS[budget]) for name in trained} == pinned


def test_the_small_budget_keeps_the_differences_of_rows() -> None:
    built = {name: MODELS[name].first_stage(SMALL, 263).vae for name in ("mld_1", "actor")}
    assert built["mld_1"] != built["actor"]
    layers = [f"mld_7_{n}_layers" for n in (7, 11)]
    vaes = [MODELS[name].first_stage(SMALL, 263).vae for name in layers]
    assert [v.transformer.layers for v in vaes if isinstance(v, TransformerVAEConfig)] == [5, 9]


def test_two_rows_are_trained_measured_and_kept(dataset: Dataset, tmp_path: Path) -> None:
    told: list[str] = []
    work = workspace_of(dataset, tmp_path, told)
    table = TABLES["text"]
    runner = TableRunner(table, work, TINY.protocol(PROTOCOL), Means())
    page = runner.run(rows_named(table, ["mld_1", "mdm_50"]))
    text = page.read_text(encoding="utf-8")
    assert "| MLD (1 token) | 0." in text.replace("| 1.00", "| 0.") and "FID, paper" in text
    assert "| Real | " in text and "0.797" in text and "budget tiny" in text
    assert sum("training" in line for line in told) == 3
    told.clear()
    assert runner.run(rows_named(table, ["mld_1", "mdm_50"])) == page
    assert not told and page.read_text(encoding="utf-8") == text
    prediction = TableRunner(TABLES["prediction"], work, TINY.protocol(PROTOCOL), Means())
    prediction.run(rows_named(prediction.table, ["epsilon"]))
    assert not any("training" in line for line in told)
    result = read_json(TableResult, tmp_path / "prediction.json")
    assert [row.row for row in result.rows] == ["real", "epsilon"]


def test_a_guidance_sweep_and_training_curves_are_drawn(dataset: Dataset, tmp_path: Path) -> None:
    told: list[str] = []
    work = workspace_of(dataset, tmp_path, told)
    once = replace(TINY.protocol(PROTOCOL), replications=1)
    for name, rows in {
        "guidance": ["scale_1", "scale_7_5"],
        "training": ["skips_80", "skips_100"],
        "steps": ["mld_ddim_5"],
    }.items():
        TableRunner(TABLES[name], work, once, Means()).run(rows_named(TABLES[name], rows))
        assert (tmp_path / f"{name}.svg").stat().st_size > 5000
        assert f"({name}.svg)" in (tmp_path / f"{name}.md").read_text(encoding="utf-8")
    assert sum("training a denoiser" in line for line in told) == 1
    assert "AITS s ↓" in (tmp_path / "steps.md").read_text(encoding="utf-8")


def test_actions_and_their_latents(dataset: Dataset, tmp_path: Path) -> None:
    work = workspace_of(dataset, tmp_path, [])
    once = replace(TINY.protocol(PROTOCOL), replications=1)
    for name, rows in {"action": ["mld"], "latents": []}.items():
        evaluator = Guesses(tuple(dataset.actions()))
        TableRunner(TABLES[name], work, once, evaluator).run(rows_named(TABLES[name], rows))
    assert "Accuracy" in (tmp_path / "action.md").read_text(encoding="utf-8")
    runner = TableRunner(TABLES["action"], work, once, Guesses(tuple(dataset.actions())))
    drawn = draw_strips(runner, rows_named(runner.table, ["mld"]), 2).read_text(encoding="utf-8")
    assert sorted(drawn.count(f">{label}<") for label in dataset.actions()) == [0, 3, 3]
    assert (tmp_path / "latents.svg").stat().st_size > 5000


def act12(folder: Path, clips: int = 48) -> Dataset:
    """A fake HumanAct12 in ACTOR's layout, prepared by the command."""
    generator = np.random.default_rng(0)
    poses = [0.3 * generator.standard_normal((60, 72)) for _ in range(clips)]
    joints = [generator.standard_normal((60, 24, 3)).cumsum(axis=0) / 50 for _ in range(clips)]
    path = folder / "humanact12poses.pkl"
    content = {"poses": poses, "joints3D": joints, "y": [n % 12 for n in range(clips)]}
    path.write_bytes(pickle.dumps(content))
    main(["data", "prepare", "humanact12", str(path), "-o", str(folder / "ha12")])
    return Dataset.load(folder / "ha12")


def test_humanact12_ends_with_a_table_on_its_only_split(tmp_path: Path) -> None:
    data = act12(tmp_path)
    work = Workspace(data, tmp_path / "out", TINY_ACTIONS, CONTEXT, lambda _: LetterCount())
    table, once = TABLES["action_humanact12"], replace(TINY.protocol(PROTOCOL), replications=1)
    runner = TableRunner(table, work, once, Guesses(tuple(data.actions())))
    text = runner.run(rows_named(table, ["mld"])).read_text(encoding="utf-8")
    assert "FID train ↓ | FID train, paper | Accuracy" in text and "split train" in text
    assert "| INR | – | 0.088 | – | 0.973 |" in text and "joints where the paper" in text
    real, mld = (row for row in runner.measured_rows().rows)
    assert mld.figures["FID train"][0] is not None and real.figures["Accuracy"][0] is not None
    with pytest.raises(DataError, match=r"split test: .* has 0 clips with a label"):
        replace(runner, table=replace(table, splits=("train", "test"))).run(table.rows)


def test_the_real_row_is_measured_alone(dataset: Dataset, tmp_path: Path) -> None:
    told: list[str] = []
    work = workspace_of(dataset, tmp_path, told)
    runner = TableRunner(TABLES["text"], work, TINY.protocol(PROTOCOL), Means())
    text = runner.run(rows_named(TABLES["text"], ["real"])).read_text(encoding="utf-8")
    assert not any("training" in line for line in told)
    alone = runner.measured_rows().rows[0].figures
    assert "| Real | 0." in text.replace("| 1.00", "| 0.") and alone["R@3"][0] is not None
    runner.run(rows_named(TABLES["text"], ["mld_1"]))
    real = runner.measured_rows().rows[0]
    assert real.row == "real" and real.figures["FID"] == alone["FID"]


def test_a_table_of_one_data_set_refuses_others_before_training(
    dataset: Dataset, tmp_path: Path
) -> None:
    told: list[str] = []
    runner = TableRunner(TABLES["text_kit"], workspace_of(dataset, tmp_path, told), CLEAN, Means())
    with pytest.raises(DataError, match=r"text_kit is of KIT.*holds synthetic"):
        runner.run(runner.table.rows)
    with pytest.raises(InputError, match=r"every column of text \(R@1.*needs an evaluator"):
        replace(runner, table=TABLES["text"], evaluator=None).run(TABLES["text"].rows)
    assert not told and not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="row 'temos': only its published figures"):
        rows_named(TABLES["text"], ["temos"])


def test_settings_that_differ_are_an_error(dataset: Dataset, tmp_path: Path) -> None:
    work = workspace_of(dataset, tmp_path, [])
    work.first_stage("mld_1")
    other = replace(work, budget=TINY.changed(["vae_training.steps=5"]))
    with pytest.raises(InputError, match=r"vae_training.steps \(4 → 5\)"):
        other.first_stage("mld_1")


def test_latents_that_are_apart_are_mapped_apart() -> None:
    generator = np.random.default_rng(0)
    labels = ["a"] * 20 + ["b"] * 20
    latents = generator.standard_normal((40, 8)) + 9 * (np.array(labels) == "b")[:, None]
    assert silhouette(map_of(latents), labels) > 0.5
    assert silhouette(generator.standard_normal((40, 8)), labels) < 0.1
    assert [t for t, _ in chosen([(float(n), latents) for n in range(51)], 3)] == [0, 25, 50]


def test_a_table_prints_ours_beside_the_papers() -> None:
    rows = (
        Row("real", "Real", "real", paper={"FID": 0.002}),
        Row("one", "One", model="mld_1", paper={"FID": 0.473}),
        Row("two", "Two", missing="there is no such data here"),
    )
    table = Table("t", "A table", "table 1", rows, ("FID", "R@1"), expects="Less is more.")
    measured = RowResult("one", "", {"FID": [12.345, 0.5], "R@1": [0.25, None]}, warnings=("odd",))
    text = markdown(table, TableResult("t", "small", "d", "clean", (measured,)), "half")
    assert "| One | 12.3 ± 0.5 | 0.473 | 0.250 |" in text
    assert "| Real | – | 0.002 | – |" in text
    assert "Two: not run, there is no such data here." in text and "Warning for one: odd" in text
    assert cell([None, None]) == "–"


def test_names_that_are_nearly_right() -> None:
    with pytest.raises(InputError, match="did you mean 'guidance'"):
        named("experiment", "guidence", TABLES)
    with pytest.raises(InputError, match="did you mean 'mld_7'"):
        rows_named(TABLES["vae"], ["mld7"])
    with pytest.raises(InputError, match="did you mean 'small'"):
        named("budget", "smal", BUDGETS)


def test_the_list_tells_rows_and_minutes() -> None:
    text = overview(TABLES.values())
    assert all(name in text for name in TABLES)
    assert minutes([Row("one", "One", model="mld_1")]) < minutes(TABLES["text"].rows)
    assert "mld_10" in rows_of(TABLES["vae"]) and "table 4" in rows_of(TABLES["vae"])
    assert Model("x").raw is False


def test_the_command_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    main(["experiment", "list"])
    assert "prediction" in capsys.readouterr().out
    main(["experiment", "list", "vae"])
    assert "VPoser-t" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["experiment", "run", "vea", "--data", str(tmp_path), "-o", str(tmp_path)])
    assert "did you mean 'vae'" in capsys.readouterr().err


def test_vaes_are_trained_in_turn_and_drawn(dataset: Dataset, tmp_path: Path) -> None:
    told: list[str] = []
    work = workspace_of(dataset, tmp_path, told)
    rows = rows_named(TABLES["vae"], ["real", "mld_1", "mld_2"])
    runner = CurveRunner(TABLES["vae"], rows, work)
    page = runner.run(hours=1e-9)
    assert [line.split(": ")[1] for line in told] == ["steps 0 to 2"] * 2
    curves = read_json(Curves, tmp_path / "vae_curves.json")
    assert [curve.row for curve in curves.rows] == ["mld_1", "mld_2"]
    assert all(len(curve.errors_mm) == 6 and curve.hours > 0 for curve in curves.rows)
    assert [point.step for point in curves.rows[0].points] == [2]
    spent = max(curve.hours for curve in curves.rows)
    CurveRunner(TABLES["vae"], rows, work).run(hours=spent * 1.01)
    curves = read_json(Curves, tmp_path / "vae_curves.json")
    assert all(curve.hours > spent and curve.step % 2 == 0 for curve in curves.rows)
    assert all(curve.points[-1].step == curve.step for curve in curves.rows)
    text = page.read_text(encoding="utf-8")
    assert (
        "| MLD-1 |" in text
        and " ± " in text
        and "| against MLD-1 |" in text
        and "(vae_curves.svg)" in text
    )
    assert (tmp_path / "vae_curves.svg").read_text(encoding="utf-8").count("MLD-2") == 1


def test_curves_need_a_vae(dataset: Dataset, tmp_path: Path) -> None:
    rows = rows_named(TABLES["guidance"], ["scale_1"])
    runner = CurveRunner(TABLES["guidance"], rows, workspace_of(dataset, tmp_path, []))
    with pytest.raises(InputError, match="rebuilds motions"):
        runner.run(hours=1)
    assert not list(tmp_path.iterdir())


def test_the_fall_of_a_curve_is_that_of_its_last_quarter() -> None:
    points = [Point(n, n / 100, error, 1.0) for n, error in ((25, 90), (75, 80), (100, 60))]
    assert last_fall(points) == "25.0%" and last_fall(points[:1]) == "–"
    assert over_clips([1.0, 3.0]).split(" ± ") == ["2.00", "1.96"] and over_clips([]) == "–"
