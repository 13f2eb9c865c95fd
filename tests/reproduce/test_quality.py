"""The table of quality, time and training: trained VAEs, cost of training, joined runs, strips."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.quality.strips import FIGURES, REAL, draw_strips, sheet, spread
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.motion import Motion
from latentmotion.reproduce.markdown import RowResult, TableResult
from latentmotion.reproduce.runner import TableRunner, interval, join_runs, joined_row
from latentmotion.reproduce.table import TABLES, rows_named
from latentmotion.reproduce.workspace import Workspace, training_cost
from latentmotion.storage.configuration import read_json, write_json
from latentmotion.training.run_folder import read_run
from tests.reproduce.test_experiments import PROTOCOL, TINY, Means, workspace_of
from tests.support.moving_figures import write_moving_figures

QUALITY = TABLES["quality"]
MADE = {"data": "d", "protocol": "clean", "budget": "small, changed", "evaluator": "one"}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("data") / "figures"
    return Dataset.load(write_moving_figures(folder, train=8, val=6))


def with_vaes(dataset: Dataset, folder: Path, told: list[str]) -> Workspace:
    """A workspace whose VAEs were trained in another folder."""
    workspace_of(dataset, folder / "curves", []).first_stage("mld_1")
    return replace(workspace_of(dataset, folder / "out", told), vaes=folder / "curves")


def test_rows_of_trained_vaes_are_measured_and_drawn(dataset: Dataset, tmp_path: Path) -> None:
    told: list[str] = []
    work = with_vaes(dataset, tmp_path, told)
    once = replace(TINY.protocol(PROTOCOL), replications=1)
    runner = TableRunner(QUALITY, work, once, Means())
    page = runner.run(rows_named(QUALITY, ["mld_1"])).read_text(encoding="utf-8")
    assert not any("training a VAE" in line for line in told)
    assert not (work.folder / "mld_1" / "vae").exists()
    assert "Training 10¹² FLOPs" in page and "Crops 10³" in page and "(quality.svg)" in page
    assert "its VAE was taken as it was: 4 steps of 4, cosine rate" in page
    figures = read_json(TableResult, work.folder / "quality.json").rows[1].figures
    assert figures["Crops"] == [2 * 4 * 4 / 1000, None]  # both stages: 4 steps of 4
    assert figures["Training"] == [training_cost(*work.run_folders("mld_1"))["Training"].mean, None]
    with pytest.raises(InputError, match="--rows mld_7"):
        work.first_stage("mld_7")
    path = draw_strips(runner, rows_named(QUALITY, ["mld_1"]), 2)
    text = path.read_text(encoding="utf-8")
    assert REAL in text and "MLD-1 of ε" in text and text.count('class="l"') == 4


def test_baselines_are_trained_as_much_as_mld(dataset: Dataset, tmp_path: Path) -> None:
    """Both stages of MLD-1 of z₀, whatever its VAE was trained for."""
    work = with_vaes(dataset, tmp_path, [])
    runner = TableRunner(QUALITY, work, replace(TINY.protocol(PROTOCOL), replications=1), Means())
    columns = {"mdm_crops": "Crops", "no_vae_flops": "Training"}
    page = runner.run(rows_named(QUALITY, ["z0", *columns])).read_text(encoding="utf-8")
    figures = {row.row: row.figures for row in runner.measured_rows().rows}
    for name, column in columns.items():
        run = read_run(work.folder / rows_named(QUALITY, [name])[0].model / "denoiser")
        steps = run.experiment.denoiser_training.steps
        mld = figures["z0"][column][0]
        assert mld is not None
        assert figures[name][column][0] == pytest.approx(mld, rel=0.5 / steps)
        quantity = {"Crops": "crops", "Training": "FLOPs"}[column]
        assert f"{steps:,} steps, as many {quantity} as both stages of MLD-1 of z₀" in page
    work.both_stages("mdm_50_crops")  # is taken as it is, not trained again


def test_other_data_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    work = with_vaes(dataset, tmp_path, [])
    other = Dataset.load(write_moving_figures(tmp_path / "other", train=7, val=6))
    with pytest.raises(InputError, match="trained on other data"):
        replace(work, dataset=other).first_stage("mld_1")


def result(seed: int, fid: float, evaluator: str = "one", budget: str = "changed") -> TableResult:
    made = {**MADE, "evaluator": evaluator}
    made["budget"] = f"small, {budget}, denoiser_training.seed={seed}"
    figures: dict[str, list[float | None]] = {"FID": [fid, 0.5], "R@3": [0.5, None]}
    rows = (
        RowResult("real", "", {"FID": [0.1, 0.02]}, made=made),
        RowResult("mld_1", "", figures, made=made, weights=str(fid)),
        RowResult("fast", "", {"FID": [1.0, 0.25]}, made=made, weights="shipped"),
    )  # fmt: skip
    return TableResult("quality", "small", "data", "clean", rows)


def written(folder: Path, results: list[TableResult]) -> list[Path]:
    folders = [folder / str(number) for number in range(len(results))]
    for place, one in zip(folders, results, strict=True):
        place.mkdir()
        write_json(place / "quality.json", one)
    return folders


def test_trainings_are_joined_by_evaluator(tmp_path: Path) -> None:
    runs = [result(0, 4.0), result(1, 6.0), result(2, 8.0), result(0, 0.5, evaluator="two")]
    output = tmp_path / "joined"
    page = join_runs(QUALITY, written(tmp_path, runs), output).read_text(encoding="utf-8")
    # 6 ± 4.303 · 2 / √3; models that are the same in all runs keep their own interval.
    assert "| MLD-1 of ε | 0.500 | 6.00 ± 4.97 |" in page
    assert "| Our shipped fast (not the paper's) | – | 1.00 ± 0.25 |" in page
    assert "mean of 3 trainings" in page and "seed=" not in page
    other = (output / "quality_2.md").read_text(encoding="utf-8")
    assert "by evaluator 2" in other and "| MLD-1 of ε | 0.500 | 0.500 ± 0.500 |" in other


def test_runs_of_other_sizes_are_not_joined(tmp_path: Path) -> None:
    folders = written(tmp_path, [result(0, 4.0), result(1, 6.0, budget="another")])
    with pytest.raises(InputError, match="mld_1 was trained in 2 ways"):
        join_runs(QUALITY, folders, tmp_path / "joined")
    assert not (tmp_path / "joined").exists()
    with pytest.raises(InputError, match=r"quality\.json"):
        join_runs(QUALITY, [tmp_path / "nothing"], tmp_path / "joined")


def test_a_row_of_another_length_says_so(tmp_path: Path) -> None:
    longer = result(0, 2.0, budget="denoiser_training.steps=9; changed: denoiser_training.steps=9")
    row = replace(longer.rows[1], row="mld_1_longer")
    folders = written(tmp_path, [result(0, 4.0), replace(longer, rows=(longer.rows[0], row))])
    page = join_runs(QUALITY, folders, tmp_path / "joined").read_text(encoding="utf-8")
    assert "| MLD-1 of ε, trained longer | 0.500 | 2.00 ± 0.50 |" in page
    assert "Warning for mld_1_longer: trained with denoiser_training.steps=9" in page


def test_a_mean_of_few_has_students_interval() -> None:
    assert interval([1.0]) is None and interval([2.0, 2.0]) == 0
    assert interval([0.0, 1.0]) == pytest.approx(12.706 / 2, rel=1e-3)
    missing = [RowResult("a", "", {"FID": [None, None]}, weights=name) for name in "xy"]
    assert joined_row(missing).figures["FID"] == [None, None]


def test_strips_show_both_sides_of_every_figure() -> None:
    steps = np.zeros((30, 22, 3), np.float32) + np.random.default_rng(0).normal(size=(22, 3))
    motion = Motion(steps)
    root = ElementTree.fromstring(sheet(["walks <fast>", "sits"], {"A": [motion, motion]}))
    space = "{http://www.w3.org/2000/svg}"
    sides = [path.get("d", "").count("M") for path in root.iter(f"{space}path")
             if path.get("class") == "l"]  # fmt: skip
    left = sum(name.startswith("left") for name in motion.skeleton.names)
    assert sides == [FIGURES * left] * 2
    assert [text.text for text in root.iter(f"{space}text")] == ["A", "walks <fast>", "sits"]


def test_prompts_are_spread_over_different_captions() -> None:
    captions = ["a", "a", "", "b", "c", "d", "b"]
    assert spread(captions, 4) == [0, 3, 4, 5] and spread(captions, 2) == [0, 4]
    for count in (0, 5):
        with pytest.raises(InputError, match="expected 1 to 4"):
            spread(captions, count)
