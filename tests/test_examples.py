"""The examples run as their first lines say, with small settings, and stay short."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.quality.rigs import MIXAMO, write_rig
from latentmotion import MotionPipeline, load
from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.samplers import sampler_named
from latentmotion.errors import InputError
from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.evaluate import GROUND_TRUTH, evaluate
from latentmotion.evaluation.protocol import CLEAN, Repeats
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import build, load_model
from tests.support.mocap_folders import write_own
from tests.support.small_training import CHANGES
from tests.test_plugins import install

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))
LINES = 40
OF_RESEARCH = 61  # Lines of an example that adds several parts.


def run(name: str, *words: object) -> None:
    importlib.import_module(f"examples.{name}").main(*map(str, words))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_says_how_it_is_run(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) < (OF_RESEARCH if path.stem in ("own_networks", "own_parts") else LINES)
    assert any(line.startswith(f"python examples/{path.name}") for line in lines)


def test_sentences_become_files(tmp_path: Path) -> None:
    run("generate", tmp_path / "walks", "a person walks", "a person turns around")
    (first,), (second,) = (load(tmp_path / f"walks/{number}.bvh") for number in (0, 1))
    assert len(first) > 10 and len(second) > 10
    assert "a person turns around" in (tmp_path / "walks/all.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("without_pullback")
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


def test_own_parts_are_trained_sampled_and_measured_by_name(
    tmp_path: Path, figures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = tmp_path / "site"
    site.mkdir()
    entries = {
        "latentmotion.vaes": {"linear": "examples.own_networks:LinearVAE"},
        "latentmotion.denoisers": {"recurrent": "examples.own_networks:recurrent"},
        "latentmotion.text_encoders": {"letters": "examples.own_parts:Letters"},
        "latentmotion.schedules": {"circle": "examples.own_parts:Circle"},
        "latentmotion.samplers": {"adams": "examples.own_sampler:AdamsBashforth"},
        "latentmotion.metrics": {"reach": "examples.own_parts:reach"},
    }
    install(site, "research", "", entries)
    monkeypatch.syspath_prepend(str(site))
    networks, parts = (importlib.import_module(f"examples.own_{n}") for n in ("networks", "parts"))
    short = {key: value for key, value in CHANGES.items() if key.partition(".")[0] != "vae"}
    short |= {"denoiser.latent_width": 8, "denoiser.condition_width": 3}
    settings = [f"--set={key}={json.dumps(value)}" for key, value in short.items()]
    common = ["--data", str(figures), "--device", "cpu", *settings, f"--set=vae={networks.VAE}"]
    main(["train", "vae", *common, "-o", str(tmp_path / "vae")])
    further = [
        f"--set={setting}"
        for setting in ("sampling.sampler=adams", parts.CIRCLE, "denoiser.plugin=recurrent")
    ]
    encoder = ["--text-encoder", "letters:abc"]
    of = ["--vae", str(tmp_path / "vae"), "-o", str(tmp_path / "run")]
    main(["train", "denoiser", *common, *further, *encoder, *of])
    model = load_model(tmp_path / "run" / "model")
    assert type(model.vae).__name__ == "LinearVAE"
    assert type(model.denoiser.body).__name__ == "Recurrent"
    pipeline = torch_pipeline(tmp_path / "run" / "model", parts.Letters("abc"))
    assert type(pipeline.sampler(pipeline.card.sampling)).__name__ == "AdamsBashforth"
    protocol = replace(CLEAN, split="val", replications=1, repeats=Repeats(0))
    report = evaluate(Generated(pipeline), Dataset.load(figures), None, protocol)
    assert report["generated"]["Reach"].mean > 0 and report[GROUND_TRUTH]["Reach"].mean > 0.1
    with pytest.raises(InputError, match="nothing is called 'recurent'; did you mean 'recurrent'"):
        build(replace(model.card.trained_denoiser, plugin="recurent"))
    with pytest.raises(InputError, match="unknown sampler 'adam'"):
        sampler_named("adam", pipeline.card.schedule)
