"""Files and names of keypoints: what is read, what is refused and why."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats.keypoints import Stated, read_keypoints
from latentmotion.kinematics.keypoints import (
    LAYOUTS,
    UNREAD,
    Keypoints,
    canonical_names,
    joint_weights,
    layout_of,
)
from latentmotion.kinematics.skeleton import HUMANML3D

COCO = LAYOUTS["coco_17"]


@pytest.fixture
def points() -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(6, 17, 3))
    points[2, 5] = np.nan
    return points


def test_files_of_all_formats_hold_the_same(tmp_path: Path, points: np.ndarray) -> None:
    np.savez(tmp_path / "a.npz", points=points, fps=30.0, names=np.array(COCO))
    np.save(tmp_path / "a.npy", points)
    frames = [[None if np.isnan(p).any() else p.tolist() for p in frame] for frame in points]
    text = json.dumps({"format": 1, "fps": 30, "names": "coco_17", "points": frames})
    (tmp_path / "a.json").write_text(text)
    header = ["time", *(f"{name}_{axis}" for name in COCO for axis in "xyz")]
    rows = [
        [f"{n / 30:.9f}", *("" if np.isnan(value) else repr(float(value)) for value in row)]
        for n, row in enumerate(points.reshape(6, -1))
    ]
    (tmp_path / "a.csv").write_text("\n".join(",".join(row) for row in [header, *rows]))
    for ending in ("npz", "npy", "json", "csv"):
        stated = Stated(fps=30.0) if ending == "npy" else Stated()
        found = read_keypoints(tmp_path / f"a.{ending}", stated)
        assert (found.names, found.fps) == (COCO, 30.0)
        np.testing.assert_array_equal(found.points, points)
        assert found.confidence[2, 5] == 0 and found.confidence.sum() == 6 * 17 - 1


def test_axes_and_cameras_are_stated(tmp_path: Path, points: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", points)
    down = read_keypoints(tmp_path / "a.npy", Stated(30.0, up="-y"))
    np.testing.assert_array_equal(down.points, points * (1, -1, -1))
    high = read_keypoints(tmp_path / "a.npy", Stated(30.0, up="z"))
    np.testing.assert_array_equal(high.points[..., 1], points[..., 2])
    np.savez(tmp_path / "b.npz", points=points[..., :2], fps=25.0, size=[640, 480], focal=500.0)
    flat = read_keypoints(tmp_path / "b.npz", Stated(focal=600.0))
    assert (flat.flat, flat.size, flat.focal) == (True, (640.0, 480.0), 600.0)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"points": [[[1, 2]]], "fps": 20, "poinst": 1}, "unknown key 'poinst': did you mean"),
        ({"fps": 20}, "points: expected a list of frames"),
        ({"points": [[[1, 2], [1, 2, 3]]], "fps": 20}, "frame 0: found .* expected 2 numbers"),
        ({"points": [[[1, "2"]]], "fps": 20}, "found '2', expected a number or null"),
        ({"points": [[[1, 2]]], "fps": 20, "format": 2}, "another format than 1"),
        ({"points": [[[1, 2]] * 9] * 3, "fps": 20}, "9 keypoints without names"),
        ({"points": [[[1, 2]] * 17] * 3}, "give it with --fps"),
        ({"points": [[[1, 2]] * 17] * 3, "fps": -1}, "fps is -1"),
        ({"points": [[[1, 2]] * 17] * 3, "fps": 20, "confidence": [[2] * 17] * 3}, "from 0"),
        ({"points": [[None] * 17] * 3, "fps": 20}, "expected"),
        ({"points": [[[1, 2]] * 17] * 3, "fps": 20, "names": "coco"}, "did you mean 'coco_17'"),
        ({"points": [[[1, 2]] * 17] * 3, "fps": 20, "names": ["knee"] * 17}, "unknown keypoint"),
        ({"points": [[[1, 2]]] * 3, "fps": 20, "size": [1, 2, 3], "names": ["head"]}, "unpack"),
        ([1], "expected an object"),
    ],
)
def test_wrong_json_is_explained(tmp_path: Path, content: object, reason: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(content))
    with pytest.raises(FileFormatError, match=reason):
        read_keypoints(path)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("time,a\n1,2", "lacks the columns"),
        ("time,head_x,head_y\n0,1", "found 2 values, expected 3"),
        ("time,head_x,head_y\n0,1,x", "found 'x', expected a number"),
        ("time,head_x,head_y\n0,1,1e40", "expected a finite number"),
        ("time,head_x,head_y\n0,1,1\n1,1,1\n9,1,1", "not evenly apart"),
        ("time,head_x,head_y\n0,1,1\n", "1 frames"),
        ("time,head_x,head_y,more\n0,1,1,1\n1,1,1,1", "unknown column 'more'"),
    ],
)
def test_wrong_tables_are_explained(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=reason):
        read_keypoints(path)


def test_unknown_endings_and_missing_files_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'.txt' .* is none of keypoints"):
        read_keypoints(tmp_path / "a.txt")
    with pytest.raises(InputError, match="there is no file"):
        read_keypoints(tmp_path / "a.csv")


def test_layouts_have_the_number_of_their_trackers() -> None:
    assert {name: len(names) for name, names in LAYOUTS.items()} == {
        "humanml3d": 22,
        "coco_17": 17,
        "body_25": 25,
        "mediapipe_33": 33,
    }
    assert layout_of(33) is LAYOUTS["mediapipe_33"]
    assert LAYOUTS["body_25"][19] == "left_big_toe" and LAYOUTS["mediapipe_33"][11:13] == (
        "left_shoulder",
        "right_shoulder",
    )
    assert "left_foot_index" not in UNREAD and "nose" in UNREAD


@pytest.mark.parametrize("layout", LAYOUTS)
def test_keypoints_are_where_their_joints_are(layout: str) -> None:
    weights = joint_weights(LAYOUTS[layout])
    read = np.array([name not in UNREAD for name in LAYOUTS[layout]])
    # A shift of the body shifts its keypoints as far.
    np.testing.assert_allclose(weights.sum(axis=1), read.astype(float), atol=1e-12)
    ankle = LAYOUTS[layout].index("left_ankle")
    assert weights[ankle].argmax() == HUMANML3D.names.index("left_ankle")


def test_names_of_openpose_are_known() -> None:
    names = ("Nose", "Neck", "RShoulder", "LBigToe", "MidHip")
    assert canonical_names(names) == (
        *("nose", "mid_shoulder", "right_shoulder"),
        *("left_big_toe", "mid_hip"),
    )
    with pytest.raises(InputError, match="given twice"):
        canonical_names(("head", "Head"))


def test_a_mask_the_wrong_way_round_is_suspected() -> None:
    with pytest.raises(InputError, match=r"0 points of joints .* mask the right way round"):
        Keypoints(np.zeros((9, 17, 3)), np.zeros((9, 17)), 20.0, COCO)
