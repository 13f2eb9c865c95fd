"""From a folder of BVH files to a model of few steps, by one command with tiny budgets."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file

from latentmotion.cli.main import main
from latentmotion.data import prepare
from latentmotion.data.dataset import Dataset
from latentmotion.engine.encoder import load_text_encoder
from latentmotion.export import package
from latentmotion.export.package import WriteTextEncoder
from latentmotion.formats.bvh import write_bvh
from latentmotion.kinematics.inverse_kinematics import solve
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.model.card import ModelCard, find_model, read_card
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import load_model
from latentmotion.training import finetune
from latentmotion.training.distillation import data as distillation_data
from latentmotion.training.finetune import FineTuning
from latentmotion.training.stages import train_denoiser
from tests.support.moving_figures import joints_of
from tests.support.small_training import CONTEXT, killed_at, small

QUICK = [
    f"--set={key}={value}"
    for key, value in {
        "rehearsal": 3,
        "distillation.few_step.steps": "[1,2]",
        "distillation.few_step.solver_steps": 2,
        "distillation.objective.trajectories": 8,
        "distillation.objective.asked": 6,
        "distillation.objective.reworded": 6,
        **{
            f"{part}training.{name}": number
            for part in ("", "distillation.")
            for name, number in {
                "steps": 4, "batch_size": 4, "sample_every": 0, "snapshot_every": 2,
                "precision": '"float32"',
            }.items()
        },
    }.items()
]  # fmt: skip


FILES = ("asked", "reworded")  # Trajectories of a student beside those for captions.


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty BVH files whose names say what they show."""
    folder, generator = tmp_path_factory.mktemp("clips"), np.random.default_rng(0)
    for number in range(20):
        joints = joints_of(generator, 30).astype(np.float32)
        write_bvh(folder / f"sneak_along_{number:02d}.bvh", solve(joints, 20.0, HUMANML3D))
    return folder


@pytest.fixture(scope="module")
def base(figures: Path, vae_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small model that reads sentences with the text encoder that ships."""
    encoder = load_text_encoder(find_model("starter"))
    experiment = small(**{"denoiser.condition_width": encoder.width, "denoiser_training.steps": 1})
    folder = tmp_path_factory.mktemp("base") / "run"
    return train_denoiser(experiment, figures, vae_run, encoder, folder, CONTEXT)


def quick_package(source: Path, card: ModelCard, text: WriteTextEncoder, output: Path) -> None:
    """Writes a model folder without its graphs, whose export takes longer than all the rest."""
    shutil.copytree(source, output)
    text(output)
    card.write(output)


def test_one_command_leads_from_clips_to_a_model_of_few_steps(
    clips: Path, base: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(finetune, "fulfills", lambda scene, check: True)
    monkeypatch.setattr(distillation_data, "judged", lambda joints, instruction: (True, 0.0))
    monkeypatch.setattr(prepare, "find_glitch", lambda joints, fps: None)
    monkeypatch.setattr(package, "package_model", quick_package)
    output, work = tmp_path / "mine", tmp_path / "mine.run"
    words = ["finetune", str(clips), "-o", str(output), "--model", str(base), *QUICK]
    words += ["--license", "CC0", "--credit", "me"]
    with killed_at(3):
        with pytest.raises(SystemExit, match="130"):
            main(words)
        raise KeyboardInterrupt
    main(words)

    card, before = read_card(output), read_card(base)
    assert card.name == "mine" and card.few_step is not None
    assert (card.vae, card.latents) == (before.vae, before.latents)
    assert "own: me" in card.provenance.data and "CC0" in card.provenance.license
    data = Dataset.load(work / "data")
    assert {source.name for source in data.sources} == {"own", "rehearsal"}
    found = [caption.text for clip in data.clips("train") for caption in clip.captions]
    assert "a person sneaks" in found  # what all names share is no news, but the verb
    motion = torch_pipeline(output)("a person sneaks along", seconds=1, steps=2)
    assert motion.joints.shape == (20, 22, 3)
    kept = {file: load_file(work / "student" / f"{file}.safetensors") for file in FILES}
    assert len(kept["asked"]["guidance"]) == 6
    assert 0 < len(kept["reworded"]["guidance"]) <= 6
    first, now = load_model(base), load_model(work / "denoiser" / "model")
    pairs = zip(first.denoiser.parameters(), now.denoiser.parameters(), strict=True)
    assert any((one != other).any() for one, other in pairs)


def test_models_that_cannot_be_taught_are_told(
    clips: Path, student: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    distilled = "--model fast: it is distilled to few steps; use the model that it is of, starter"
    for model, message in [(student, "reads no sentences"), ("fast", distilled)]:
        with pytest.raises(SystemExit):
            main(["finetune", str(clips), "-o", str(tmp_path / "out"), "--model", str(model)])
        assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_missing_table_is_told(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["finetune", str(clips), "-o", str(tmp_path / "m"), "--captions", "none.csv"])
    assert capsys.readouterr().err.startswith("error: no file none.csv; expected a CSV")
    assert not list(tmp_path.iterdir())


def test_defaults_hold_for_the_model_that_ships() -> None:
    assert finetune.student_of(find_model("starter")) == find_model("fast")
    fast, starter = (read_card(find_model(name)) for name in ("fast", "starter"))
    assert fast.latents == starter.latents
    assert FineTuning().distillation.few_step == fast.few_step
