"""Models and run folders of version 1 are read: those that ship, and those made by the inverse."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from latentmotion.errors import InputError
from latentmotion.model.card import find_model, read_card, shipped_models
from latentmotion.model.config import FewStepConfig
from latentmotion.model.version_1 import KEYS, upgraded, upgraded_weights
from latentmotion.networks.checkpoint import load_model
from latentmotion.pipeline import MotionPipeline
from latentmotion.training.distillation.data import Distillation, TrajectoryRegression
from latentmotion.training.distillation.stage import distill
from latentmotion.training.experiment import with_changes
from latentmotion.training.presets import preset_named
from tests.support.small_training import CONTEXT, killed_at, short_distillation
from tests.support.version_1 import downgraded, write_version_1_model, write_version_1_run

SETTINGS = short_distillation(
    FewStepConfig(guidance=(1.0, 4.0), steps=(1, 2), solver_steps=4),
    TrajectoryRegression(trajectories=64),
    sample_every=0,
)


@pytest.fixture(scope="module")
def distilled(
    figures: Path, unconditional_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The run folder of a distillation, whose snapshot and trajectories are kept."""
    folder = tmp_path_factory.mktemp("version_1") / "run"
    distill(SETTINGS, figures, unconditional_run / "model", None, folder, CONTEXT)
    return folder


@pytest.mark.parametrize("name", shipped_models())
def test_shipped_models_are_read_in_both_versions(name: str, tmp_path: Path) -> None:
    card = read_card(find_model(name))
    card.write(tmp_path)
    assert json.loads((tmp_path / "model.json").read_text())["format"] == 2
    assert read_card(tmp_path) == card


def test_a_model_folder_of_version_1_generates_the_same(student: Path, tmp_path: Path) -> None:
    for name in ("new", "old"):
        shutil.copytree(student, tmp_path / name)
    write_version_1_model(tmp_path / "old")
    assert [path.name for path in (tmp_path / "old").glob("walk_*")] == ["walk_2.onnx"]
    assert read_card(tmp_path / "old") == read_card(tmp_path / "new")
    for fused in (True, False):
        motions = []
        for name in ("new", "old"):
            if not fused:
                for path in (*(tmp_path / name).glob("walk_*"), *(tmp_path / name).glob("fused_*")):
                    path.unlink()
            pipeline = MotionPipeline.from_pretrained(tmp_path / name)
            assert bool(pipeline.backend.fused) == fused
            motions.append(pipeline("3", seconds=1.0, seed=3, steps=2).joints)
        np.testing.assert_array_equal(*motions, err_msg=f"fused {fused}")
    weights = (load_model(tmp_path / name).denoiser.state_dict() for name in ("new", "old"))
    assert all(torch.equal(*pair) for pair in zip(*(w.values() for w in weights), strict=True))


def test_a_run_folder_of_version_1_is_resumed(
    distilled: Path, figures: Path, unconditional_run: Path, tmp_path: Path
) -> None:
    teacher, run = unconditional_run / "model", tmp_path / "run"
    with killed_at(5):
        distill(SETTINGS, figures, teacher, None, run, CONTEXT)
    write_version_1_run(run)
    kept = (run / "ways.safetensors").read_bytes()
    with pytest.raises(InputError, match=r"differing: settings\.huber_delta"):
        changed = with_changes(SETTINGS, ["huber_delta=2.0"])
        distill(changed, figures, teacher, None, run, CONTEXT)
    found = load_file(
        distill(SETTINGS, figures, teacher, None, run, CONTEXT) / "weights.safetensors"
    )
    whole = load_file(distilled / "model" / "weights.safetensors")
    assert found.keys() == whole.keys()
    assert all(torch.equal(found[name], whole[name]) for name in whole)
    assert (run / "ways.safetensors").read_bytes() == kept
    assert not (run / "trajectories.safetensors").exists()


def test_a_version_1_first_stage_is_found(
    figures: Path, vae_run: Path, unconditional_run: Path, tmp_path: Path
) -> None:
    shutil.copytree(vae_run, tmp_path / "vae")
    write_version_1_run(tmp_path / "vae")
    write_version_1_model(tmp_path / "vae" / "model")
    assert read_card(tmp_path / "vae" / "model") == read_card(vae_run / "model")


def test_a_later_version_is_refused(vae_run: Path, figures: Path, tmp_path: Path) -> None:
    from latentmotion.training.run_folder import Run, read_run

    data = json.loads((vae_run / "experiment.json").read_text())
    (tmp_path / "experiment.json").write_text(json.dumps(data | {"format": 3}))
    with pytest.raises(InputError, match="format 3, expected 2; update latentmotion"):
        read_run(Run, tmp_path)


@pytest.mark.parametrize("name", ["starter", "mld_humanml3d", "mdm"])
def test_the_table_is_undone_by_its_inverse(name: str) -> None:
    from latentmotion.storage.configuration import to_json

    for settings in (preset_named(name), Distillation()):
        data = json.loads(json.dumps(to_json(settings)))
        old = downgraded(data)
        assert old != data and upgraded(old) == data


def test_old_settings_are_understood_and_named() -> None:
    changes = [
        "vae_objective.steps=0.25",
        "reading.words=3",
        'denoiser.leaps={"kind": "Leaps", "of": 8}',
    ]
    with pytest.warns(FutureWarning, match=r" is deprecated; use \w+"):
        experiment = with_changes(preset_named("starter"), changes)
    assert experiment.vae_objective.velocity == 0.25
    assert experiment.conditioning.words == 3
    assert experiment.denoiser.few_step == FewStepConfig(solver_steps=8)
    changes = ["leaps.of=8", 'objective={"kind": "Regression", "ways": 5}', "knee=2"]
    with pytest.warns(FutureWarning, match=r" is deprecated; use \w+"):
        distillation = with_changes(Distillation(), changes)
    assert distillation.few_step.solver_steps == 8 and distillation.huber_delta == 2
    assert distillation.objective == TrajectoryRegression(5)


def test_no_new_name_is_an_old_one() -> None:
    for names in KEYS.values():
        assert not set(names) & set(names.values())


def test_names_of_weights() -> None:
    names = "denoiser.leaps.stride.a", "leaps.guidance.b", "denoiser.places.table.table"
    names += "vae.place.table", "vae.decoder.place.table", "place.table", "vae.encoder.x"
    assert list(upgraded_weights(dict.fromkeys(names))) == [
        "denoiser.step_embedding.step_size.a",
        "step_embedding.guidance.b",
        "denoiser.positions.table.table",
        "vae.position.table",
        "vae.decoder.position.table",
        "position.table",
        "vae.encoder.x",
    ]
