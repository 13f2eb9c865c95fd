"""HumanAct12 on the user's SMPL body: what the classifier sees, what reports and motions say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.data.sources.actor import ACTIONS
from latentmotion.diffusion.condition import ActionTask
from latentmotion.errors import InputError
from latentmotion.evaluation.evaluators.action import (
    ActionClassifier,
    MotionGRUConfig,
    Recognizer,
    save_action_classifier,
)
from latentmotion.evaluation.evaluators.interface import load_evaluator
from latentmotion.evaluation.scores import with_smpl_joints
from latentmotion.formats import load
from latentmotion.kinematics.smpl import load_smpl
from latentmotion.model.config import DenoiserConfig, LatentSpace, Sampling, TransformerVAEConfig
from latentmotion.networks.checkpoint import save_model
from latentmotion.representation.smpl import representation_of
from latentmotion.storage.files import sha256
from tests.support.action_files import write_humanact12
from tests.support.moving_figures import write_moving_figures
from tests.support.synthetic_smpl import synthetic_arrays, write_synthetic_smpl
from tests.support.untrained import SMALL, card, untrained


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Prepared data, a model of 60 frames, the classifier and a body half as large again."""
    folder = tmp_path_factory.mktemp("bodies")
    poses = write_humanact12(folder / "poses.pkl", frames=(62, 65, 61, 60))
    main(["data", "prepare", "humanact12", str(poses), "-o", str(folder / "data")])
    denoiser = DenoiserConfig(
        16, 12, SMALL, False, "table", positions="latents_first", sine_width=16
    )
    about = card(150, "smpl", LatentSpace(16, tokens=1))
    labels = ActionTask(ACTIONS)
    about = replace(about, condition=labels, frames=(60, 60), sampling=Sampling(2, 1.0))
    vae = TransformerVAEConfig(features=150, transformer=SMALL, position="sine")
    save_model(folder / "model", untrained(about, vae, denoiser))
    torch.manual_seed(0)
    gru = MotionGRUConfig()
    classifier = ActionClassifier(ACTIONS, "smpl", gru)
    save_action_classifier(folder / "gru", classifier, gru.build().state_dict())
    large = 1.5 * synthetic_arrays()["v_template"]
    write_synthetic_smpl(folder / "smpl.npz", v_template=large)
    return folder


def evaluated(folder: Path, *options: str) -> dict:
    words = ["--data", str(folder / "data"), "--evaluator", str(folder / "gru"), *options]
    output = folder / f"report{len(options)}"
    split = Dataset.load(folder / "data").manifest.clips[0].split
    main(["evaluate", str(folder / "model"), *words, "--split", split, "--replications", "1",
          "-o", str(output)])  # fmt: skip
    return json.loads((output / "report.json").read_text())


@pytest.mark.filterwarnings("default:the test set is not the paper's")
def test_reports_tell_whose_joints_were_seen(folder: Path) -> None:
    free = evaluated(folder)
    assert free["provenance"]["body"] == ""
    assert any("joints are those of the free skeleton" in note for note in free["notes"])
    # A classifier that sees other joints than its own is compared with no published row.
    assert not free["warnings"]
    body = folder / "smpl.npz"
    real = evaluated(folder, "--body", str(body))
    assert any("ground truth" in line for line in real["warnings"])  # of an untrained network
    assert "1,191 clips in train" in real["warnings"][0]
    assert real["provenance"]["body"] == sha256(body)
    assert not any("free skeleton" in note for note in real["notes"])
    first, second = (report["rows"]["ground truth"] for report in (free, real))
    assert first["Diversity"] != second["Diversity"]
    assert first["Jitter"] != second["Jitter"]


def test_the_classifier_sees_the_bodys_joints(folder: Path) -> None:
    body, dataset = load_smpl(folder / "smpl.npz"), Dataset.load(folder / "data")
    data, evaluator = with_smpl_joints(body, dataset, load_evaluator(folder / "gru"))
    assert isinstance(evaluator, Recognizer)
    features = dataset.features(dataset.clips(dataset.manifest.clips[0].split)[0])
    seen = evaluator.prepare(features)
    np.testing.assert_allclose(seen, representation_of(body).camera_joints(features))
    bones = np.linalg.norm(seen[0, 4] - seen[0, 1]) / np.linalg.norm(
        dataset.representation.skeleton.offsets[4]
    )
    assert bones == pytest.approx(1.5, rel=1e-4)
    assert data.fingerprint == dataset.fingerprint


def test_a_body_is_refused_where_features_are_no_poses(folder: Path, tmp_path: Path) -> None:
    other = Dataset.load(write_moving_figures(tmp_path / "figures", train=1, val=1))
    with pytest.raises(InputError, match="no poses of a SMPL body"):
        with_smpl_joints(load_smpl(folder / "smpl.npz"), other, None)


def test_generated_motions_have_the_bodys_joints_and_the_models_one_length(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def generate(*options: str) -> np.ndarray:
        main(["generate", "walk", "--model", str(folder / "model"), "--no-clean", *options,
              "-o", str(tmp_path / "a.npz")])  # fmt: skip
        return load(tmp_path / "a.npz")[0].joints

    free, real = generate(), generate("--body", str(folder / "smpl.npz"))
    assert len(free) == len(real) == 60

    def thigh(joints: np.ndarray) -> float:
        return float(np.linalg.norm(joints[0, 4] - joints[0, 1]))

    assert thigh(real) == pytest.approx(1.5 * thigh(free), rel=1e-4)
    for words, message in {
        ("--seconds", "4"): "makes motions of 3 to 3 seconds",
        ("--model", "starter", "--body", str(folder / "smpl.npz")): "no poses of a SMPL body",
    }.items():
        with pytest.raises(SystemExit):
            generate(*words)
        assert message in capsys.readouterr().err
