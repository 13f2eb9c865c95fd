"""Bodies with fingers: 52 joints from a file to a trained model and back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.data.sources.smpl_hands import hand_poses, joints_with_hands
from latentmotion.engine.request import GenerationRequest
from latentmotion.errors import FileFormatError
from latentmotion.formats.smpl_npz import read_arrays
from latentmotion.kinematics.skeleton import HANDS
from latentmotion.motion import Motion
from latentmotion.networks.backend import torch_pipeline
from latentmotion.representation.humanml3d import HANDS_FEATURES
from latentmotion.training.stages import train_denoiser
from tests.support.small_training import CHANGES, CONTEXT, LetterCount, small


def write_amass(path: Path, numbers: int, seed: int, fist: float = 0.8) -> Path:
    """A body that sways for three seconds and closes its hands; SMPL-H has 156 numbers."""
    generator, time = np.random.default_rng(seed), np.arange(180)[:, None] / 60
    poses = 0.2 * np.sin(2 * np.pi * (generator.uniform(0.3, 1, numbers) * time))
    poses[:, :3], poses[:, 66:] = (np.pi / 2, 0, 0), 0
    start = 66 if numbers == 156 else 75
    poses[:, start + 2 : start + 90 : 3] = fist * np.minimum(time, 1)
    trans = np.concatenate([0.3 * time, 0 * time, 0 * time + 1], axis=1)
    np.savez(path, poses=poses, trans=trans, mocap_framerate=60.0, betas=np.zeros(16))
    path.with_suffix(".txt").write_text("a person closes the left hand\n")
    return path


@pytest.mark.parametrize("numbers", [156, 165])
def test_fingers_are_read_where_the_body_is(tmp_path: Path, numbers: int) -> None:
    path = write_amass(tmp_path / "a.npz", numbers, 0)
    hands = hand_poses(path)
    assert hands is not None and hands.shape == (180, 30, 3)
    joints, fps = joints_with_hands(path, hands)
    body = read_arrays(path, dict(np.load(path))).joints
    np.testing.assert_allclose(joints[:, :22], body, atol=1e-6)
    assert joints.shape == (180, 52, 3) and fps == 60
    bones = joints[:, 22:] - joints[:, list(HANDS.parents[22:])]
    lengths = np.linalg.norm(bones, axis=-1)
    wanted = np.linalg.norm(HANDS.offsets[22:], axis=1)
    np.testing.assert_allclose(lengths, np.broadcast_to(wanted, lengths.shape), atol=1e-5)
    tip, wrist = joints[:, 22 + 2], joints[:, 20]
    reach = np.linalg.norm(tip - wrist, axis=-1)
    assert reach[-1] < 0.9 * reach[0], "a closed hand is shorter"


def test_files_without_fingers_say_so(tmp_path: Path) -> None:
    assert hand_poses(write_amass(tmp_path / "a.npz", 156, 0, fist=0.0)) is None
    np.savez(tmp_path / "b.npz", poses=np.full((3, 156), np.nan), trans=np.zeros((3, 3)))
    with pytest.raises(FileFormatError, match="not finite"):
        hand_poses(tmp_path / "b.npz")


def test_52_joints_are_prepared_trained_and_generated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = tmp_path / "raw"
    raw.mkdir()
    for number in range(10):
        write_amass(raw / f"{number}.npz", 156, number)
    write_amass(raw / "bare.npz", 156, 99, fist=0.0)
    face = dict(np.load(write_amass(raw / "face.npz", 165, 98)))
    face["poses"][:, 66:75] = 0.2
    np.savez(raw / "face.npz", **face)
    own = ["data", "prepare", "own", str(raw), "--val", "0.2", "--test", "0"]
    main([*own, "-o", str(tmp_path / "body")])
    told = capsys.readouterr().out
    assert "part 0: the poses of its fingers; --hands keeps them" in told
    assert "part face: the poses of its jaw and eyes" in told
    main([*own, "--hands", "-o", str(tmp_path / "data")])
    told = capsys.readouterr().out
    assert "bare: " in told and "has no poses of fingers" in told
    dataset = Dataset.load(tmp_path / "data")
    assert dataset.representation is HANDS_FEATURES and dataset.representation.width == 623
    clip = dataset.clips("train")[0]
    features = dataset.features(clip)
    mirrored = HANDS_FEATURES.decode(dataset.features(dataset.clips("train", mirrored=True)[1]))
    left, right = HANDS.names.index("left_index3"), HANDS.names.index("right_index3")
    joints = HANDS_FEATURES.decode(features)
    np.testing.assert_allclose(mirrored[:, left] * (-1, 1, 1), joints[:, right], atol=1e-4)
    settings = [f"--set={key}={json.dumps(value)}" for key, value in CHANGES.items()]
    common = ["--data", str(tmp_path / "data"), "--device", "cpu", *settings]
    main(["train", "vae", *common, "--set=vae.features=623", "-o", str(tmp_path / "vae")])
    data, vae, encoder = tmp_path / "data", tmp_path / "vae", LetterCount()
    folder = train_denoiser(small(), data, vae, encoder, tmp_path / "run", CONTEXT)
    pipeline = torch_pipeline(folder, encoder)
    (made,) = pipeline.generate(
        GenerationRequest(("a person",), (24,), (0,), pipeline.card.sampling)
    )
    motion = Motion(HANDS_FEATURES.decode(made), 20.0, HANDS)
    assert motion.joints.shape == (24, 52, 3) and np.isfinite(motion.joints).all()
    motion.save(tmp_path / "hands.bvh")
    assert "left_thumb3" in (tmp_path / "hands.bvh").read_text()
