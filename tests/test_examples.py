"""The examples run as their first lines say, with small settings, and stay short."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.quality.rigs import MIXAMO, write_rig
from latentmotion import MotionPipeline, load
from tests.support.mocap_folders import write_own
from tests.support.small_training import CHANGES

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
LINES = 40


def run(name: str, *words: object) -> None:
    importlib.import_module(f"examples.{name}").main(*map(str, words))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_says_how_it_is_run(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) < LINES
    assert any(line.startswith(f"python examples/{path.name} ") for line in lines)


def test_sentences_become_files(tmp_path: Path) -> None:
    run("generate", tmp_path / "walks", "a person walks", "a person turns around")
    (first,), (second,) = (load(tmp_path / f"walks/{number}.bvh") for number in (0, 1))
    assert len(first) > 10 and len(second) > 10
    assert "a person turns around" in (tmp_path / "walks/all.html").read_text(encoding="utf-8")


def test_own_takes_train_both_stages(tmp_path: Path) -> None:
    takes = [f"take{number}" for number in range(12)]
    write_own(tmp_path / "takes", takes)
    for name in takes:
        (tmp_path / f"takes/{name}.txt").write_text("a person sways\n")
    changes = {key: value for key, value in CHANGES.items() if key != "denoiser.condition_width"}
    for stage in ("vae", "denoiser"):
        changes |= {f"{stage}_training.{name}": 2 for name in ("steps", "validate_every")}
    settings = [f"--set={key}={json.dumps(value)}" for key, value in changes.items()]
    run("train_on_own_mocap", tmp_path / "takes", tmp_path, *settings, "--device", "cpu")
    assert MotionPipeline.from_pretrained(tmp_path / "model").card.provenance.commands
    assert len(load(tmp_path / "walk.bvh")[0]) == 40


def test_an_own_sampler_comes_near_the_models_own() -> None:
    own = importlib.import_module("examples.own_sampler").Pipeline.from_pretrained("starter")
    found = own("a person walks forward", 4.0, steps=30)
    generate = MotionPipeline.from_pretrained("starter")
    by_ddim = generate("a person walks forward", 4.0, steps=30, sampler="ddim")
    assert np.abs(found.joints - by_ddim.joints).mean() < 0.1


def test_settings_of_a_model_are_compared(
    figures: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    evaluate = importlib.import_module("examples.evaluate")
    monkeypatch.setattr(evaluate, "SETTINGS", ((1, 1.0), (2, 4.0)))
    run("evaluate", "starter", figures, "val")
    printed = capsys.readouterr().out
    assert "2 steps, guidance 4" in printed and "ground truth" in printed


def test_a_motion_is_put_on_a_character(tmp_path: Path) -> None:
    character = write_rig(tmp_path / "character.glb", MIXAMO)
    run("retarget", character, "a person waves", tmp_path / "waving.glb", 1)
    (found,) = load(tmp_path / "waving.glb")
    assert len(found) == 20
