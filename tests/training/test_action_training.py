"""The paper's models for actions, small, on a file in HumanAct12's layout and a made-up body."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.networks.checkpoint import build
from latentmotion.training import vae
from latentmotion.training.experiment import preset_named
from latentmotion.training.vae import BatchSampler, FeatureCache, items_by_length
from tests.support.action_files import write_humanact12
from tests.support.synthetic_smpl import write_synthetic_smpl

pytest.importorskip("torch")

SMALL = [
    *("vae.transformer.layers=1", "vae.transformer.width=16", "vae.transformer.heads=2"),
    *("vae_training.steps=4", "vae_training.batch_size=2", "vae_training.sample_every=4"),
    *("denoiser.transformer.layers=1", "denoiser.transformer.width=16", "denoiser.latent_width=16"),
    *("denoiser.transformer.heads=2", "denoiser_training.steps=2"),
    *("denoiser_training.batch_size=2", "latents.per_item=2"),
]
CHANGES = [word for change in SMALL for word in ("--set", change)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("actions")
    write_humanact12(folder / "humanact12poses.pkl")
    write_synthetic_smpl(folder / "smpl.npz")
    poses, out = folder / "humanact12poses.pkl", folder / "data"
    main(["data", "prepare", "humanact12", str(poses), "-o", str(out)])
    return folder


def train_vae(folder: Path, *words: str, run: str = "vae") -> None:
    data, out = str(folder / "data"), str(folder / run)
    preset = ["--preset", "mld_humanact12", *CHANGES, "--device", "cpu"]
    main(["train", "vae", "--data", data, "-o", out, *preset, *words])


def test_presets_have_the_authors_sizes() -> None:
    count = {}
    for name in ("mld_humanact12", "mld_uestc"):
        experiment = preset_named(name)
        for part, network in (("vae", experiment.vae), ("denoiser", experiment.denoiser)):
            count[name, part] = sum(p.numel() for p in build(network).parameters())
    assert count["mld_humanact12", "vae"] == count["mld_uestc", "vae"] == 11_136_918
    # Theirs has a table of positions more, which it never uses.
    assert count["mld_humanact12", "denoiser"] == 13_156_864 - 500 * 256
    assert count["mld_uestc", "denoiser"] - count["mld_humanact12", "denoiser"] == 28 * 256


def test_both_stages_with_a_body_and_what_the_run_keeps(folder: Path) -> None:
    train_vae(folder, "--body", str(folder / "smpl.npz"))
    journal = (folder / "vae" / "journal.jsonl").read_text().splitlines()
    lines = [json.loads(line) for line in journal]
    assert any("vertices" in line for line in lines)
    assert not any("val_mm" in line for line in lines)
    run = json.loads((folder / "vae" / "experiment.json").read_text())
    assert len(run["parents"]["body"]) == 64
    words = ["--vae", str(folder / "vae"), "-o", str(folder / "denoiser"), "--device", "cpu"]
    preset = ["--data", str(folder / "data"), "--preset", "mld_humanact12", *CHANGES]
    main(["train", "denoiser", *preset, *words])
    card = json.loads((folder / "denoiser" / "model" / "model.json").read_text())
    assert (card["condition"]["kind"], card["representation"]) == ("ActionTask", "smpl")
    assert card["frames"] == [60, 60]
    assert card["condition"]["labels"] == ["throw", "walk", "warm_up"]


def test_a_student_of_few_steps_takes_labels(folder: Path) -> None:
    student = folder / "student"
    few = ["objective.trajectories=64", "training.steps=2", "training.batch_size=2"]
    changes = [word for change in few for word in ("--set", change)]
    words = ["--data", str(folder / "data"), "-o", str(student), "--device", "cpu", *changes]
    main(["train", "distill", "--teacher", str(folder / "denoiser"), *words])
    card = json.loads((student / "model" / "model.json").read_text())
    assert (card["condition"]["kind"], card["frames"]) == ("ActionTask", [60, 60])
    assert card["denoiser"]["few_step"]["steps"] == [1, 2, 4]


def test_a_body_is_asked_for_and_refused_where_it_is_of_no_use(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without = ("--set", "vae_objective.vertices=0")
    for words, message in (
        ((), "needs a SMPL model file"),
        (("--body", str(folder / "none.npz")), "no such file; bring a SMPL model"),
        ((*without, "--body", str(folder / "smpl.npz")), "--body is of no use"),
    ):
        with pytest.raises(SystemExit):
            train_vae(folder, *words, run="other")
        assert message in capsys.readouterr().err
    assert not (folder / "other").exists()


def test_a_run_goes_on_with_the_same_body_alone(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train_vae(folder, "--body", str(folder / "smpl.npz"), run="again")
    other = write_synthetic_smpl(tmp_path / "other.npz", v_template=np.zeros((192, 3)))
    with pytest.raises(SystemExit):
        train_vae(folder, "--body", str(other), run="again")
    assert "parents.body" in capsys.readouterr().err


def test_crops_begin_where_the_root_is_at_zero(folder: Path) -> None:
    dataset = Dataset.load(folder / "data")
    cropping, clips = preset_named("mld_humanact12").vae_cropping, dataset.clips("train")
    memory = FeatureCache(dataset, clips, dataset.normalizer)
    crops = BatchSampler(items_by_length(clips, 60), 4, cropping, 0)(0)
    assert {crop.frames for crop in crops} == {60}
    assert any(crop.start > 0 for crop in crops)
    features, _ = memory.batch(crops, 60)
    _, way = dataset.representation.pose(features)
    np.testing.assert_array_equal(way[:, 0], np.zeros((len(crops), 3)))


def test_crops_of_more_than_fits_are_read_from_the_shards(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset = Dataset.load(folder / "data")
    cropping, clips = preset_named("mld_humanact12").vae_cropping, dataset.clips("train")
    crops = BatchSampler(items_by_length(clips, 60), 4, cropping, 0)(0)
    kept = FeatureCache(dataset, clips, dataset.normalizer).batch(crops, 60)
    monkeypatch.setattr(vae, "MOST_CACHED", 1000)
    opened: list[str] = []
    features = Dataset.features

    def counted(self: Dataset, clip: Clip) -> np.ndarray:
        opened.append(clip.id)
        return features(self, clip)

    memory = FeatureCache(dataset, clips, dataset.normalizer)
    monkeypatch.setattr(Dataset, "features", counted)
    read = memory.batch(crops, 60)
    assert opened == [crop.clip.id for crop in crops]
    np.testing.assert_array_equal(read[0], kept[0])
