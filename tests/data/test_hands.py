"""Bodies with fingers: 52 joints from a file to a trained model and back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.dataset import Dataset
from latentmotion.data.sources.own import whole_body
from latentmotion.engine.request import GenerationRequest
from latentmotion.errors import FileFormatError
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
    body = whole_body(path)
    assert body is not None and body.hands is not None and body.hands.shape == (180, 30, 3)
    motion = Motion.load(path)
    joints = body.joints(motion)
    np.testing.assert_allclose(joints[:, :22], motion.joints, atol=1e-6)
    assert joints.shape == (180, 52, 3) and motion.fps == 60
    bones = joints[:, 22:] - joints[:, list(HANDS.parents[22:])]
    lengths = np.linalg.norm(bones, axis=-1)
    wanted = np.linalg.norm(HANDS.offsets[22:], axis=1)
    np.testing.assert_allclose(lengths, np.broadcast_to(wanted, lengths.shape), atol=1e-5)
    tip, wrist = joints[:, 22 + 2], joints[:, 20]
    reach = np.linalg.norm(tip - wrist, axis=-1)
    assert reach[-1] < 0.9 * reach[0], "a closed hand is shorter"


def test_files_without_fingers_say_so(tmp_path: Path) -> None:
    resting = whole_body(write_amass(tmp_path / "a.npz", 156, 0, fist=0.0))
    assert resting is not None and resting.hands is None
    np.savez(tmp_path / "b.npz", poses=np.full((3, 156), np.nan), trans=np.zeros((3, 3)))
    with pytest.raises(FileFormatError, match="not finite"):
        whole_body(tmp_path / "b.npz")


def write_motionx(path: Path, amass: Path) -> Path:
    """The frames of an AMASS file of SMPL-H as Motion-X's scripts turn them: y up, 322 numbers."""
    with np.load(amass) as file:
        poses, (x, y, z) = file["poses"], file["trans"].T
    frames = np.zeros((len(poses), 322))
    frames[:, :156] = poses
    frames[:, :3] = 0  # AMASS's quarter turn about x, undone
    frames[:, 309:312] = np.stack([x, z, -y], axis=1)
    frames[:, 209:309], frames[:, 312:] = 0.5, 0.5  # shapes, which are not read
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, frames)
    return path


@pytest.mark.parametrize(("subset", "fps"), [("idea400", 30), ("humanml", 20), ("GRAB", 20)])
def test_motionx_has_the_joints_of_the_same_amass_file(
    tmp_path: Path, subset: str, fps: float
) -> None:
    amass = write_amass(tmp_path / "a.npz", 156, 0)
    path = write_motionx(tmp_path / subset / "a.npy", amass)
    ours, theirs, body = Motion.load(path), Motion.load(amass), whole_body(path)
    of_amass = whole_body(amass)
    assert ours.fps == fps and body is not None and of_amass is not None
    shift = ours.joints[0, 0] - theirs.joints[0, 0]  # SMPL-X's template is another
    np.testing.assert_allclose(ours.joints - shift, theirs.joints, atol=1e-5)
    np.testing.assert_allclose(body.joints(ours) - shift, of_amass.joints(theirs), atol=1e-5)
    assert not body.face_moves


def test_motionx_is_prepared_with_its_texts_and_lists(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motions, texts = tmp_path / "smplx_322", tmp_path / "semantic_labels"
    (texts / "idea400").mkdir(parents=True)
    for number in range(6):
        amass = write_amass(tmp_path / "a.npz", 156, number, fist=0.8 * (number > 0))
        path = write_motionx(motions / "idea400" / f"wave_{number}.npy", amass)
        (texts / "idea400" / f"wave_{number}.txt").write_text(f"a person waves {number} times")
    face = np.load(path)
    face[:, 159] = 1.0
    np.save(path, face)
    (texts / "test.txt").write_text("idea400/wave_1\nidea400/not_there\n")
    (texts / "val.txt").write_text("idea400/wave_2\n")
    np.save(motions / "idea400" / "features.npy", np.zeros((9, 263)))
    damaged = np.lib.format.header_data_from_array_1_0(np.zeros((1, 322)))
    with (motions / "idea400" / "huge.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {**damaged, "shape": (10**12, 322)})
    np.save(motions / "idea400" / "nan.npy", np.full((30, 322), np.nan))
    own = ["data", "prepare", "own", str(motions), "--captions", str(texts), "--val=0", "--test=0"]
    main([*own, "--hands", "-o", str(tmp_path / "hands")])
    told = capsys.readouterr().out
    assert "part idea400/wave_5: the poses of its face: jaw, eyes, expression" in told
    assert "idea400/wave_0: " in told and "has no poses of fingers" in told
    assert "idea400/features: " in told
    assert "is larger than the file" in told and "finite" in told
    dataset = Dataset.load(tmp_path / "hands")
    assert dataset.representation is HANDS_FEATURES
    splits = {clip.id: clip.split for split in ("train", "val", "test")
              for clip in dataset.clips(split)}  # fmt: skip
    assert splits == {
        **{f"idea400-wave_{number}": "train" for number in (3, 4, 5)},
        **{"idea400-wave_1": "test", "idea400-wave_2": "val"},
    }
    (clip,) = dataset.clips("test")
    assert clip.captions[0].text == "a person waves 1 times"
    assert clip.frames == 119  # 180 frames at 30, six seconds, are 120; features have one less
    main([*own, "-o", str(tmp_path / "body")])
    told = capsys.readouterr().out
    assert "part idea400/wave_3: the poses of its fingers; --hands keeps them" in told
    assert "expected an array" in told
    assert len(Dataset.load(tmp_path / "body").clips("train")) == 4


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
    assert "part face: the poses of its face: jaw, eyes, expression" in told
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
