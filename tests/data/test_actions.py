"""Action data: HumanAct12's and UESTC's files in their own layout, and folders of labels."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.clip import Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.recording import Dropped, Recording
from latentmotion.data.sources.actor import TRAIN_SUBJECTS, depth_shifts, uestc_recordings
from latentmotion.data.sources.own import OwnMotions
from latentmotion.errors import DataError, FileFormatError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.motion import Motion
from tests.support.action_files import VIDEOS, poses, write_humanact12, write_uestc
from tests.support.mocap_folders import swaying, write_own


def turn_about_y(angle: float) -> np.ndarray:
    return matrix_from_axis_angle(np.array([0.0, angle, 0.0]))


# HumanAct12.


def test_humanact12(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write_humanact12(tmp_path / "humanact12poses.pkl")
    main(["data", "check", str(tmp_path)])
    assert f"data prepare humanact12 {file}" in capsys.readouterr().out
    main(["data", "prepare", "humanact12", str(file), "-o", str(tmp_path / "out")])
    dataset = Dataset.load(tmp_path / "out")
    clips = dataset.clips("train")
    assert [clip.frames for clip in clips] == [80, 60, 61, 70]
    assert [clip.action for clip in clips] == ["walk", "walk", "throw", "warm_up"]
    assert not dataset.clips("test") and not dataset.clips("val")
    assert dataset.actions() == ["throw", "walk", "warm_up"]
    assert (dataset.normalizer.mean == 0).all() and (dataset.normalizer.std == 1).all()
    capsys.readouterr()
    main(["data", "check", str(tmp_path / "out")])
    assert "actions: 3 (throw 1, walk 2, warm_up 1)" in capsys.readouterr().out


def test_humanact12_features_are_the_poses(tmp_path: Path) -> None:
    write_humanact12(tmp_path / "a.pkl")
    main(["data", "prepare", "humanact12", f"{tmp_path}/a.pkl", "-o", f"{tmp_path}/out"])
    dataset = Dataset.load(tmp_path / "out")
    short = dataset.features(dataset.clips("train")[1])
    vectors, joints = poses(40, seed=1)
    rotations, way = dataset.representation.pose(short)
    np.testing.assert_allclose(rotations[:40], matrix_from_axis_angle(vectors), atol=1e-6)
    np.testing.assert_allclose(way[:40], joints[:, 0] - joints[0, 0], atol=1e-6)
    assert (short[40:] == short[39]).all()
    found = dataset.representation.camera_joints(short)[:40]
    np.testing.assert_allclose(found[:, :15], (joints - joints[0, 0])[:, :15], atol=1e-5)


def test_humanact12_clips_may_keep_their_length(tmp_path: Path) -> None:
    write_humanact12(tmp_path / "a.pkl")
    words = f"data prepare humanact12 {tmp_path}/a.pkl --hold 0 -o {tmp_path}/out"
    main(words.split())
    assert [c.frames for c in Dataset.load(tmp_path / "out").clips("train")] == [80, 40, 61, 70]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([1, 2], "expected poses, joints3D, y, found list"),
        ({"poses": [], "y": []}, "found poses, y"),
        ({"poses": [1], "joints3D": [], "y": [1]}, "1 and 0 and 1 clips"),
        ({"poses": [1], "joints3D": [1], "y": [12]}, "action 12; expected 0 to 11"),
    ],
)
def test_humanact12_of_another_layout(tmp_path: Path, content: object, message: str) -> None:
    from latentmotion.data.sources.actor import humanact12_recordings

    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(content))
    with pytest.raises(FileFormatError, match=message):
        list(humanact12_recordings(path, 60))


def test_humanact12_clips_that_cannot_be_used_are_told(tmp_path: Path) -> None:
    from latentmotion.data.sources.actor import humanact12_recordings

    nan = np.full((50, 72), np.nan)
    content = {"poses": [nan, np.zeros((5, 66))], "joints3D": [np.zeros((50, 24, 3))] * 2}
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content | {"y": [0, 1]}))
    dropped = list(humanact12_recordings(tmp_path / "a.pkl", 60))
    assert all(isinstance(item, Dropped) for item in dropped)
    assert [item.reason.split(",")[0] for item in dropped] == [
        "numbers that are not finite",
        "poses (5",
    ]


# UESTC.


def test_uestc(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_uestc(tmp_path / "uestc")
    main(["data", "check", str(tmp_path)])
    assert f"data prepare uestc {folder}" in capsys.readouterr().out
    main(["data", "prepare", "uestc", str(folder), "-o", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    assert "view 8 of side 2" in printed
    assert "44 frames, fewer than 45" in printed
    dataset = Dataset.load(tmp_path / "out")
    assert [(c.id, c.action, c.frames) for c in dataset.clips("train")] == [
        ("a0_d0_p001_c1", "action-0", 70),
        ("a1_d2_p002_c2", "action-1", 65),
    ]
    (test,) = dataset.clips("test", mirrored=False)
    assert (test.action, test.frames) == ("left-kicking", 60)
    assert dataset.clips("test", mirrored=True)[1].action == "right-kicking"


def test_uestc_is_turned_to_the_front_by_eighths(tmp_path: Path) -> None:
    items = list(uestc_recordings(write_uestc(tmp_path / "u", shifts=True), 0))
    assert isinstance(items[2], Dropped)
    from latentmotion.representation.smpl import SMPL_FEATURES

    for index, turn in ((0, np.eye(3)), (1, turn_about_y(-np.pi / 2)), (3, np.eye(3))):
        frames = (70, 65, 50, 30)[index]
        vectors, joints = poses((70, 70, 50, 30)[index], seed=index)
        rotations, way = SMPL_FEATURES.pose(items[index].features)
        expected = matrix_from_axis_angle(vectors)[:frames]
        np.testing.assert_allclose(rotations[:, 0], turn @ expected[:, 0], atol=1e-5)
        np.testing.assert_allclose(rotations[:, 1:], expected[:, 1:], atol=1e-5)
        walked = (joints[:frames, 0] - joints[0, 0]) @ turn.T
        np.testing.assert_allclose(way, walked, atol=1e-5)


def test_depth_is_where_perspective_matches_the_weak_camera() -> None:
    random = np.random.default_rng(0)
    camera = random.uniform(0.3, 0.9, (6, 4))
    joints = random.normal(size=(6, 49, 3))
    depths = []
    for (scale, _, x, y), body in zip(camera, joints, strict=True):  # as ACTOR solves for it
        image = (scale * (body[:, :2] + [x, y]) + 1) / 2 * 540
        height = np.linalg.norm(np.ptp(body[:, :2], axis=0))
        depths.append(500 * height / np.linalg.norm(np.ptp(image, axis=0)))
    expected = np.column_stack([camera[:, 2:], depths])
    np.testing.assert_allclose(depth_shifts(camera), expected - expected[0], atol=1e-12)


def test_uestc_lacks_something(tmp_path: Path) -> None:
    folder = write_uestc(tmp_path / "u")
    assert len(TRAIN_SUBJECTS) == 51
    names = folder / "info/names.txt"
    for change, message in (
        (lambda: names.write_text("\n".join([*VIDEOS[:-1], "walk.avi"])), "expected names like"),
        (lambda: names.write_text(VIDEOS[0]), "1 names|of 5 videos"),
        (names.unlink, "no file .*names.txt"),
    ):
        change()
        with pytest.raises((DataError, FileFormatError), match=message):
            list(uestc_recordings(folder, 60))


# Folders of labels.


def write_labelled(folder: Path) -> Path:
    write_own(folder, ["wave left/a", "wave left/b", "walk/deep/c", "test/walk/d", "stray"])
    for name in ("a", "b"):
        (folder / "wave left" / f"{name}.txt").write_text("he waves\n")
    Motion(swaying(90, 30.0).joints(), 30.0).save(folder / "walk" / "e.npz")
    Motion(swaying(90, 60.0).joints(), 60.0).save(folder / "walk" / "f.npz")
    return folder


def test_folders_are_labels(tmp_path: Path) -> None:
    motions = OwnMotions(
        write_labelled(tmp_path), Source("x", "", ""), labelled=True, test=0, val=0
    )
    items = list(motions.recordings())
    found = {i.label.id: i.label for i in items if isinstance(i, Recording)}
    assert {name: label.action for name, label in found.items()} == {
        "wave left-a": "wave left",
        "wave left-b": "wave left",
        "walk-deep-c": "deep",
        "test-walk-d": "walk",
        "walk-e": "walk",
        "walk-f": "walk",
    }
    assert found["wave left-a"].mirrored_action == "wave right"
    assert found["wave left-a"].sentences[0].text == "he waves"
    assert {name for name, label in found.items() if label.split == "test"} == {"test-walk-d"}
    (stray,) = [item for item in items if isinstance(item, Dropped)]
    assert (stray.id, "no folder" in stray.reason) == ("stray", True)
    lengths = {i.label.id: len(i.joints) for i in items if isinstance(i, Recording)}
    assert (lengths["walk-e"], lengths["walk-f"]) == (60, 30)


@pytest.mark.parametrize("representation", ["humanml3d", "smpl"])
def test_prepare_labelled(tmp_path: Path, representation: str) -> None:
    write_labelled(tmp_path / "in")
    words = f"data prepare labelled {tmp_path}/in -o {tmp_path}/out --val 0 --test 0"
    main([*words.split(), "--representation", representation])
    dataset = Dataset.load(tmp_path / "out")
    assert dataset.manifest.representation == representation
    assert dataset.actions() == ["deep", "walk", "wave left"]
    assert len(dataset.clips("train")) == 5
    identity = bool((dataset.normalizer.std == 1).all())
    assert identity == (representation == "smpl")


def test_an_npz_of_something_else_is_told_and_takes_are_clips(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    motion = Motion(swaying(90, 20.0).joints(), 20.0)
    from latentmotion import formats

    formats.save(tmp_path / "a" / "two.npz", [motion, motion])
    (tmp_path / "a" / "bad.npz").write_bytes(b"x")
    bad, *takes = OwnMotions(tmp_path, Source("x", "", ""), labelled=True).recordings()
    assert isinstance(bad, Dropped) and "not a motion file" in bad.reason
    assert len({take.label.id for take in takes if isinstance(take, Recording)}) == 2
