"""Files and names of keypoints: what is read, what is refused and why."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion.errors import FileFormatError, InputError, ReadingWarning
from latentmotion.formats.keypoints import KeypointOptions, read_keypoints
from latentmotion.kinematics.keypoints import (
    LAYOUTS,
    UNREAD,
    Keypoints,
    canonical_names,
    grounded,
    joint_weights,
    layout_of,
)
from latentmotion.kinematics.skeleton import HUMANML3D
from tests.support.walker import walker

COCO = LAYOUTS["coco_17"]


def seen_as(layout: str, frames: int = 6) -> np.ndarray:
    """Returns what a tracker sees of a walk; what is not read of a body is at the head."""
    joints = walker(frames).joints()
    weights = joint_weights(LAYOUTS[layout])
    weights[weights.sum(axis=1) == 0, HUMANML3D.names.index("head")] = 1
    return np.einsum("kj,tjc->tkc", weights, joints)


@pytest.fixture
def points() -> np.ndarray:
    points = seen_as("coco_17")
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
        stated = (
            KeypointOptions(fps=30.0, names="coco_17") if ending == "npy" else KeypointOptions()
        )
        found = read_keypoints(tmp_path / f"a.{ending}", stated)
        assert (found.names, found.fps) == (COCO, 30.0)
        np.testing.assert_array_equal(found.points, points)
        assert found.confidence[2, 5] == 0 and found.confidence.sum() == 6 * 17 - 1


def test_axes_and_cameras_are_stated(tmp_path: Path, points: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", points)
    down = read_keypoints(tmp_path / "a.npy", KeypointOptions(30.0, "coco_17", up="-y"))
    np.testing.assert_array_equal(down.points, points * (1, -1, -1))
    high = read_keypoints(tmp_path / "a.npy", KeypointOptions(30.0, "coco_17", up="z"))
    np.testing.assert_array_equal(high.points[..., 1], points[..., 2])
    np.savez(tmp_path / "b.npz", points=points[..., :2], fps=25.0, size=[640, 480], focal=500.0)
    flat = read_keypoints(tmp_path / "b.npz", KeypointOptions(focal=600.0))
    assert (flat.flat, flat.size, flat.focal) == (True, (640.0, 480.0), 600.0)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"points": [[[1, 2]]], "fps": 20, "poinst": 1}, "unknown key 'poinst': did you mean"),
        ({"fps": 20}, "points: expected a list of frames"),
        ({"points": [[[1, 2], [1, 2, 3]]], "fps": 20}, "frame 0: found .* expected 2 numbers"),
        ({"points": [[[1, "2"]]], "fps": 20}, "found .1, '2'., expected 2 numbers or null"),
        ({"points": [[[1, 2]]], "fps": 20, "format": 2}, "another format than 1"),
        ({"points": [[[1, 2]] * 9] * 3, "fps": 20}, "9 keypoints without names"),
        ({"points": [[[1, 2]] * 17] * 3}, "give it with --fps"),
        ({"points": [[[1, 2]] * 17] * 3, "fps": -1}, "fps is -1"),
        (
            {"points": [[[0.1, 1, 2]] * 17] * 3, "fps": 20},
            "coco_17 or h36m, which have other",
        ),
        ({"people": []}, "holds nobody"),
        ({"points": [[None] * 17] * 3, "fps": 20}, "expected"),
        ({"points": [[[1, 2]] * 17] * 3, "fps": 20, "names": "coco"}, "did you mean 'coco_1"),
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
        ("time,head_x,head_y\n0,1,x", "found 'x', expected a finite number"),
        ("time,head_x,head_y\n0,1,1e40", "expected a finite number"),
        ("time,head_x,head_y\n0,1,1\n1,1,1\n2,1,1\n9,1,1", "not evenly apart: 7 s after 2 s"),
        ("time,head_x,head_y\n0,1,1\n1,1,1\n1,1,1", "do not rise"),
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
        **{"humanml3d": 22, "coco_17": 17, "h36m": 17, "coco_18": 18, "body_25": 25},
        **{"halpe_26": 26, "halpe_136": 136, "coco_133": 133, "mediapipe_33": 33},
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


def person(frame: np.ndarray, score: float = 0.9) -> list[float]:
    return [float(value) for point in frame for value in (*point, score)]


def openpose(folder: Path, pixels: np.ndarray) -> Path:
    """A file for each frame; in the second nobody is seen, in others two people."""
    folder.mkdir()
    for number, frame in enumerate(pixels):
        people = [] if number == 1 else [{"pose_keypoints_2d": person(frame)}] * 2
        text = json.dumps({"version": 1.3, "people": people})
        (folder / f"clip_{number:012}_keypoints.json").write_text(text)
    return folder


def alphapose(path: Path, pixels: np.ndarray) -> Path:
    rows = [
        {"image_id": f"{n}.jpg", "keypoints": person(frame, 1.1), "score": 2.0}
        for n, frame in enumerate(pixels)
        for _ in range(2)
    ]
    path.write_text(json.dumps(rows))
    return path


def mmpose(path: Path, pixels: np.ndarray) -> Path:
    frames = [
        {
            "frame_id": n,
            "instances": [{"keypoints": frame.tolist(), "keypoint_scores": [0.9] * len(frame)}],
        }
        for n, frame in enumerate(pixels)
    ]
    path.write_text(json.dumps({"meta_info": {}, "instance_info": frames}))
    return path


TRACKERS = {
    "a folder of OpenPose": ("body_25", lambda folder, p: openpose(folder / "clip", p)),
    "a file of AlphaPose": ("halpe_26", lambda folder, p: alphapose(folder / "a.json", p)),
    "a file of MMPose": ("coco_133", lambda folder, p: mmpose(folder / "a.json", p)),
    "pixels with scores": ("coco_18", lambda folder, p: scored(folder / "a.npy", p)),
}


def scored(path: Path, pixels: np.ndarray) -> Path:
    np.save(path, np.concatenate([pixels, np.full((*pixels.shape[:2], 1), 0.9)], axis=2))
    return path


@pytest.mark.filterwarnings("ignore:.*scores go up to 1.1:latentmotion.errors.ReadingWarning")
@pytest.mark.parametrize("tracker", TRACKERS)
def test_what_trackers_write_is_read(tracker: str, tmp_path: Path) -> None:
    layout, write = TRACKERS[tracker]
    pixels = 400 - 200 * seen_as(layout)[..., :2]
    found = read_keypoints(write(tmp_path, pixels), KeypointOptions(fps=30.0))
    assert found.flat and len(found) == len(pixels)
    seen = found.confidence[:, LAYOUTS[layout].index("left_knee")] > 0
    np.testing.assert_allclose(found.points[seen], pixels[seen])
    assert seen.sum() == len(pixels) - ("OpenPose" in tracker)
    assert found.confidence[seen].min() > 0.89 and found.confidence.max() <= 1


def test_landmarks_of_mediapipe_with_their_visibility(tmp_path: Path) -> None:
    points = seen_as("mediapipe_33") * (1, -1, -1)
    np.save(tmp_path / "a.npy", np.concatenate([points, np.ones((6, 33, 1))], axis=2))
    with pytest.warns(ReadingWarning, match=r"a guess: -y is taken to point up.*\(or --up\)$"):
        found = read_keypoints(tmp_path / "a.npy", KeypointOptions(fps=30.0))
    np.testing.assert_allclose(found.points, points * (1, -1, -1))
    header = ["frame", *(f"{axis}{n}" for n in range(33) for axis in "xyzv")]
    rows = [
        [str(n), *(f"{value:.6f}" for point in frame for value in (*point, 0.9))]
        for n, frame in enumerate(points * (1, -1, -1))
    ]
    (tmp_path / "a.csv").write_text("\n".join(",".join(row) for row in [header, *rows]))
    table = read_keypoints(tmp_path / "a.csv", KeypointOptions(fps=30.0))
    np.testing.assert_allclose(table.points, found.points, atol=1e-6)
    with pytest.raises(FileFormatError, match="give it with --fps"):
        read_keypoints(tmp_path / "a.csv")


@pytest.mark.parametrize(("unit", "meters"), [("millimeters", 0.001), ("centimeters", 0.01)])
def test_other_units_are_guessed_by_the_limbs_or_stated(
    unit: str, meters: float, tmp_path: Path
) -> None:
    points = seen_as("mediapipe_33")
    np.save(tmp_path / "a.npy", points / meters)
    with pytest.warns(ReadingWarning, match=f"lengths are taken for {unit}, by the limbs"):
        found = read_keypoints(tmp_path / "a.npy", KeypointOptions(fps=30.0))
    np.testing.assert_allclose(found.points, points)
    for stated in (unit, meters, str(meters)):
        found = read_keypoints(tmp_path / "a.npy", KeypointOptions(fps=30.0, unit=stated))
        np.testing.assert_allclose(found.points, points)


def test_uneven_times_are_made_even(tmp_path: Path) -> None:
    times = np.arange(40) / 20 + np.random.default_rng(0).uniform(-0.01, 0.01, 40)
    header = ["timestamp", "head_x", "head_y", "head_z", "head_score"]
    rows = [f"{t},{t},1,{-t},0.9" for t in times.tolist()]
    (tmp_path / "a.csv").write_text("\n".join([",".join(header), *rows]))
    found = read_keypoints(tmp_path / "a.csv", KeypointOptions(up="y"))
    assert 19 < found.fps < 21
    even = times[0] + np.arange(len(found)) / found.fps
    np.testing.assert_allclose(found.points[:, 0, 0], even, atol=0.02)


def test_points_around_the_hips_are_put_on_the_floor_with_a_path() -> None:
    walk = seen_as("mediapipe_33", 60)
    names = LAYOUTS["mediapipe_33"]
    hips = walk[:, [names.index("left_hip"), names.index("right_hip")]].mean(axis=1, keepdims=True)
    found, guessed = grounded(walk - hips, names, 20.0)
    assert guessed
    feet = [n for n, name in enumerate(names) if name.endswith("foot_index")]
    assert abs(np.median(found[:, feet, 1].min(axis=1))) < 0.02
    same, guessed = grounded(walk, names, 20.0)
    assert not guessed and same is walk
