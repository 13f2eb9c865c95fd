"""Every task from training to motions: what is asked, what is learned, what is refused."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.data.store import read_manifest
from latentmotion.diffusion.condition import ActionCondition, ActionTask, Unconditional
from latentmotion.errors import InputError
from latentmotion.export import onnx
from latentmotion.model.card import read_card
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.vae.interface import MotionVAE
from latentmotion.storage.configuration import write_json
from latentmotion.training.stages import train_denoiser
from latentmotion.training.task_conditions import ConditionTable
from tests.support.fixtures import Once
from tests.support.moving_figures import write_moving_figures
from tests.support.small_training import CHANGES, CONTEXT, small

LABELS = [f"sway{side}{number}" for side in ("Left", "Right") for number in range(3)]


def trained(task: str, figures: Path, vae_run: Path, folder: Path) -> Path:
    """Trains by the command, as a user does."""
    changes = {**CHANGES, "task": task, "denoiser_training.sample_every": 8}
    options = [f"--set={key}={json.dumps(value)}" for key, value in changes.items()]
    main(["train", "denoiser", "--data", str(figures), "--vae", str(vae_run), *options,
          "--device", "cpu", "-o", str(folder)])  # fmt: skip
    return folder / "model"


@pytest.fixture(scope="module")
def actions(figures: Path, vae_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained("action", figures, vae_run, tmp_path_factory.mktemp("runs") / "actions")


@pytest.fixture(scope="module")
def nothing(figures: Path, vae_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained("unconditional", figures, vae_run, tmp_path_factory.mktemp("runs") / "nothing")


def test_labels_are_those_of_the_training_clips(actions: Path) -> None:
    card = read_card(actions)
    assert card.task == "action"
    assert card.condition == ActionTask(tuple(LABELS))
    assert card.trained_denoiser.condition_width == 6
    assert (actions.parent / "samples-0000008.png").stat().st_size > 1000


def test_mirrored_copies_have_labels_of_their_own(
    figures: Path, vae_run: Path, tmp_path: Path
) -> None:
    experiment = small(task="action", mirrored=False, **{"denoiser_training.steps": 1})
    model = train_denoiser(experiment, figures, vae_run, None, tmp_path / "run", CONTEXT)
    assert read_card(model).condition.labels == tuple(LABELS[:3])


def test_an_action_model_generates(actions: Path) -> None:
    generate = torch_pipeline(actions)
    features = generate.features(["swayLeft1", "swayRight0"], [24, 41], [3, 4], steps=2)
    assert [len(each) for each in features] == [24, 41]
    one, other = (
        generate("swayLeft1", 1.2, 3, steps=2, guidance=g, clean_up=None).joints for g in (1, 50)
    )
    assert np.abs(one - other).max() > 0
    assert generate("swayLeft1", 1.2).caption == "swayLeft1"
    for prompt, message in {
        "swayLeft": "did you mean 'swayLeft[0-2]'",
        "a person walks": "known are swayLeft0, swayLeft1",
        "": "takes an action label; known are swayLeft0",
    }.items():
        with pytest.raises(InputError, match=message):
            generate(prompt)


def test_an_unconditional_model_generates(nothing: Path) -> None:
    assert read_card(nothing).sampling.guidance == 1
    generate = torch_pipeline(nothing)
    plain, guided = (generate(seconds=1.2, seed=3, steps=2, guidance=g).joints for g in (1, 7))
    np.testing.assert_allclose(plain, guided, atol=1e-4)
    assert len(generate.features(["", ""], [24, 41], [3, 4])[1]) == 41
    with pytest.raises(InputError, match="takes no prompt; leave 'a person walks' out"):
        generate("a person walks")


@pytest.fixture
def coders_traced_once(once: Once, monkeypatch: pytest.MonkeyPatch) -> None:
    """The VAE, which both models have, is traced for one of them."""
    for name in ("export_decoder", "export_encoder"):
        monkeypatch.setattr(onnx, name, partial(_copied, once, getattr(onnx, name)))


def _copied(
    once: Once, export: Callable[..., None], vae: MotionVAE, number: int | None, path: Path
) -> None:
    shutil.copyfile(once(path.name, lambda file: export(vae, number, file)), path)


@pytest.mark.usefixtures("without_pullback", "coders_traced_once")
@pytest.mark.parametrize("task", ["actions", "nothing"])
def test_models_without_sentences_run_as_graphs(
    task: str, request: pytest.FixtureRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model: Path = request.getfixturevalue(task)
    main(["export", str(model), "-o", str(tmp_path / "model")])
    assert not (tmp_path / "model" / "tokenizer.json").exists()
    prompts = ["swayLeft1", "swayRight0"] if task == "actions" else ["", ""]
    expected = torch_pipeline(tmp_path / "model").features(prompts, [24, 41], [3, 4], steps=3)
    for runtime in ("onnxruntime", "openvino"):
        graphs = MotionPipeline.from_pretrained(tmp_path / "model", runtime, 1)
        found = graphs.features(prompts, [24, 41], [3, 4], steps=3)
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-3)


def test_the_command_asks_each_model_for_what_it_takes(
    actions: Path, nothing: Path, vae_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def generate(*words: str) -> list[str]:
        output = ["-o", str(tmp_path / "out.npz"), "--seconds", "1.2", "--json", "--no-clean"]
        main(["generate", *words, *output])
        return [motion["caption"] for motion in json.loads(capsys.readouterr().out)["motions"]]

    def refused(*words: str) -> str:
        with pytest.raises(SystemExit):
            generate(*words)
        return capsys.readouterr().err

    run = ["--steps", "2", "--model"]
    assert generate("swayLeft1", "swayRight2", *run, str(actions.parent)) == [
        "swayLeft1",
        "swayRight2",
    ]
    assert generate("--count", "2", "--sampler", "ddpm", *run, str(nothing)) == ["", ""]
    assert generate("--count", "3", "--prior", "--model", str(vae_run)) == [""] * 3
    assert "no action given; model 'starter' knows swayLeft0" in refused(*run, str(actions))
    assert "takes no prompt" in refused("a person walks", *run, str(nothing))
    assert "takes no prompt" in refused("a person walks", "--prior", "--model", str(vae_run))
    assert "--prior" in refused("a person walks", *run, str(vae_run))
    assert "omit --text-encoder" in export_refused(actions, tmp_path, capsys)


def export_refused(model: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit):
        main(["export", str(model), "--text-encoder", "starter", "-o", str(folder / "model")])
    return capsys.readouterr().err


def test_pytorch_runs_what_was_not_exported_or_says_that_it_is_missing(
    actions: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    words = ["generate", "swayLeft1", "--steps", "1", "--no-clean", "-o", str(tmp_path / "a.npz")]
    main([*words, "--model", str(actions)])
    assert "has no graphs (latentmotion export); PyTorch runs it" in capsys.readouterr().err
    monkeypatch.setattr("latentmotion.cli.loading.find_spec", lambda name: None)
    with pytest.raises(SystemExit):
        main([*words, "--model", str(actions)])
    assert "latentmotion export, or here: pip install" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*words, "--model", str(actions), "--runtime", "pytorch"])
    assert 'pip install "latentmotion[train]"' in capsys.readouterr().err


def test_data_without_labels_cannot_train_actions(
    figures: Path, vae_run: Path, tmp_path: Path
) -> None:
    folder = write_moving_figures(tmp_path / "figures")
    manifest = read_manifest(folder)
    bare = tuple(replace(c, action=None, mirrored_action=None) for c in manifest.clips)
    write_json(folder / "manifest.json", replace(manifest, clips=bare))
    with pytest.raises(InputError, match="has an action label"):
        train_denoiser(small(task="action"), folder, vae_run, None, tmp_path / "run", CONTEXT)
    with pytest.raises(InputError, match="needs a text encoder"):
        train_denoiser(small(), figures, vae_run, None, tmp_path / "run", CONTEXT)


def test_labels_only_held_out_clips_have_are_left_out(
    figures: Path, vae_run: Path, tmp_path: Path
) -> None:
    folder = write_moving_figures(tmp_path / "figures")
    manifest = read_manifest(folder)
    *known, last = manifest.clips
    write_json(
        folder / "manifest.json", replace(manifest, clips=(*known, replace(last, action="new")))
    )
    experiment = small(task="action", **{"denoiser_training.steps": 1})
    model = train_denoiser(experiment, folder, vae_run, None, tmp_path / "run", CONTEXT)
    assert "new" not in read_card(model).condition.labels


def test_a_table_of_prompts_has_the_null_condition_under_the_empty_prompt() -> None:
    device = torch.device("cpu")
    table = ConditionTable(ActionCondition(("kick", "walk")), ["walk", ""], device)
    np.testing.assert_array_equal(table(["", "walk"]).tokens[:, 0], [[0, 0], [0, 1]])
    table = ConditionTable(Unconditional(3), [], device)
    assert table(["", ""]).tokens.shape == (2, 0, 3)
