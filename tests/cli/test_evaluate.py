"""`latentmotion evaluate`: what it prints, writes and refuses."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from latentmotion.cli.main import main
from latentmotion.model.card import find_model, read_card
from latentmotion.networks.checkpoint import FirstStageModel, load_model, save_model
from tests.support.moving_figures import write_moving_figures

ROWS = ["ground truth", "generated", "reconstruction (mean z)", "reconstruction (sampled z)"]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_moving_figures(tmp_path_factory.mktemp("data") / "figures", train=4, val=2)


def run(model: str | Path, data: Path, *options: str | Path, steps: int | None = 2) -> None:
    common = ["--data", data, "--split", "val", *([] if steps is None else ["--steps", steps])]
    main(["evaluate", str(model), *map(str, [*common, *options])])


def test_report_and_card(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "model"
    shutil.copytree(find_model("starter"), model)
    run(model, data, "-o", tmp_path / "report", "--card", "--cost")
    printed = capsys.readouterr().out
    assert f"| metric | {' | '.join(ROWS)} |" in printed
    vae = load_model(model).vae
    parameters = sum(weights.numel() for weights in vae.parameters())
    assert f"parameters: vae {parameters:,}" in printed and "AITS" in printed
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert list(report["rows"]) == ROWS
    figures = read_card(model).figures["evaluation"]
    assert figures["motions"]["generated"] == 2
    found = report["rows"]["reconstruction (mean z)"]["MPJPE"]["mean"]
    assert figures["rows"]["reconstruction (mean z)"]["MPJPE"] == pytest.approx(found, rel=1e-3)
    assert load_model(model).card.figures["vae_train_mm"] > 0


def test_a_vae_alone_and_its_prior(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full = load_model(find_model("starter"))
    save_model(tmp_path / "vae", FirstStageModel(replace(full.card, denoiser=None), full.vae))
    run(tmp_path / "vae", data, "--protocol", "paper", steps=None)
    assert "| ground truth | reconstruction (sampled z) | reconstruction (mean z) |" in (
        capsys.readouterr().out
    )
    run(tmp_path / "vae", data, "--prior", "--replications", "2", steps=None)
    printed = capsys.readouterr().out
    assert "| ground truth | prior |" in printed and "2 replications" in printed


def test_mistakes_are_one_line(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for options in (["-e", tmp_path], ["--replications", "0"]):
        with pytest.raises(SystemExit):
            run("starter", data, *options)
        error = capsys.readouterr().err.strip()
        assert error.startswith("error: ") and "\n" not in error
