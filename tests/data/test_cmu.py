from __future__ import annotations

import tarfile
from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.prepare import encode
from latentmotion.data.recording import Dropped, EncodedRecording, Recording
from latentmotion.data.sources.cmu import CmuTrials, find_trials, native_fps, trial_of
from latentmotion.data.sources.humanml3d import read_index, read_splits
from latentmotion.errors import DataError
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from tests.support.mocap_folders import (
    CMU_FILES,
    swaying,
    write_annotations,
    write_cmu_trials,
)


def trials() -> dict:
    """120 fps: 05_18 and 06_01 make 200 frames at 20 fps, 07_01 makes 50."""
    return {
        "05_18": swaying(1200),
        "06_01": swaying(1200, seed=1),
        "07_01": swaying(300, seed=2),
    }


@pytest.fixture(params=[False, True], ids=["texts", "texts.json.xz"])
def data(tmp_path: Path, request: pytest.FixtureRequest) -> CmuTrials:
    write_cmu_trials(tmp_path / "raw" / "deep", trials())
    annotations = write_annotations(tmp_path / "h3d", *CMU_FILES, request.param)
    return CmuTrials.load(tmp_path / "raw", annotations)


def by_id(items) -> dict:
    return {i.label.id if isinstance(i, Recording) else i.id: i for i in items}


def test_cutting_aligns_after_the_t_pose(data: CmuTrials) -> None:
    cut = by_id(data.recordings())["000002"]
    expected = trials()["05_18"].joints()[::6][20:60]
    np.testing.assert_allclose(cut.joints, expected, atol=1e-5)
    assert cut.label.origin == "05_18[20:60]"
    assert cut.label.split == "train"


def test_frames_that_blend_with_the_t_pose_are_replaced(data: CmuTrials) -> None:
    cut = by_id(data.recordings())["000001"]
    expected = trials()["05_18"].joints()[::6][:40]
    np.testing.assert_allclose(cut.joints[1:], expected[1:], atol=1e-5)
    assert 0 < np.abs(cut.joints[0] - expected[0]).max() < 0.02


def test_captions_of_both_sides(data: CmuTrials) -> None:
    label = by_id(data.recordings())["000001"].label
    assert [s.text for s in label.sentences] == ["he waves left.", "he stops."]
    assert [s.text for s in label.mirrored_sentences] == ["he waves right."]


def test_a_clip_past_the_end_of_its_trial_is_dropped(data: CmuTrials) -> None:
    dropped = by_id(data.recordings())["000004"]
    assert isinstance(dropped, Dropped)
    assert "50 frames at 20 fps, index wants 90" in dropped.reason


def test_clips_of_absent_trials_are_counted(data: CmuTrials) -> None:
    assert data.missing == 1


def test_what_is_left_of_trials_without_val_and_test(data: CmuTrials) -> None:
    items = by_id(data.recordings(uncaptioned=True)).values()
    pieces = [i.label for i in items if isinstance(i, Recording) and i.label.id.startswith("cmu-")]
    assert [(label.origin, label.split) for label in pieces] == [("05_18[60:200]", "train")]
    assert not pieces[0].sentences


@pytest.mark.parametrize(
    ("remove", "message"),
    [("index.csv", "lacks index.csv"), ("texts", "found neither"), ("val.txt", "lacks val.txt")],
)
def test_missing_annotations(tmp_path: Path, remove: str, message: str) -> None:
    write_cmu_trials(tmp_path / "raw", {"05_18": swaying(300)})
    folder = write_annotations(tmp_path / "h3d", *CMU_FILES)
    (folder / remove).rename(folder / "elsewhere")
    with pytest.raises(DataError, match=message) as error:
        CmuTrials.load(tmp_path / "raw", folder)
    assert "github.com/EricGuo5513/HumanML3D" in str(error.value)


def test_an_index_of_something_else(tmp_path: Path) -> None:
    (tmp_path / "index.csv").write_text("a,b\n1,2\n")
    with pytest.raises(DataError, match=r"lacks the column source_path.*found a, b"):
        read_index(tmp_path)
    (tmp_path / "index.csv").write_text("source_path,start_frame,end_frame,new_name\nx,a,b,c\n")
    with pytest.raises(DataError, match=r"index.csv:2"):
        read_index(tmp_path)


def test_folders_without_trials(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no folder"):
        find_trials(tmp_path / "none")
    with pytest.raises(DataError, match=r"found none.*mocap.cs.cmu.edu"):
        find_trials(tmp_path)


def test_a_damaged_trial_is_dropped_and_the_others_stay(tmp_path: Path) -> None:
    raw = write_cmu_trials(tmp_path / "raw", {"05_18": swaying(1200)})
    (raw / "06").mkdir()
    (raw / "06" / "06_01.bvh").write_text("HIERARCHY\nROOT")
    data = CmuTrials.load(raw, write_annotations(tmp_path / "h3d", *CMU_FILES))
    items = by_id(data.recordings())
    assert "06_01.bvh" in items["06_01"].reason
    assert isinstance(items["000001"], Recording)


def test_the_index_has_all_2913_clips(shared: Path) -> None:
    folder = shared / "data/humanml3d"
    rows = [row for row in read_index(folder) if "/CMU/" in row.path]
    splits = read_splits(folder)
    assert len(rows) == 2913
    assert len({row.path for row in rows}) == len({trial_of(row.path) for row in rows}) == 2082
    assert all(row.id in splits for row in rows)


def test_the_second_person_of_two_has_a_trial_of_her_own() -> None:
    assert trial_of("./pose_data/CMU/18_19_Justin/18_03_poses.npy") == "18_03"
    assert trial_of("./pose_data/CMU/18_19_rory/18_03_poses.npy") == "19_03"
    assert trial_of("./pose_data/CMU/22_23_Rory/22_03_poses.npy") == "23_03"
    assert trial_of("./pose_data/KIT/3/kick_high_left02_poses.npy") is None


def test_known_rates(shared: Path) -> None:
    import json

    rates = json.loads((shared / "data/cmu_fps.json").read_text())
    assert {trial: native_fps(trial) for trial in rates} == rates


def test_real_trials(tmp_path: Path, shared: Path) -> None:
    for archive, count in (("cmu_asfamc", 6), ("cmu_bvh", 5)):
        with tarfile.open(shared / f"data/{archive}.tar.xz", "r|xz") as tar:
            for _, member in zip(range(count), tar, strict=False):
                tar.extract(member, tmp_path / "raw", filter="data")
    data = CmuTrials.load(tmp_path / "raw", shared / "data/humanml3d")
    encoded = [encode(item, HUMANML3D_FEATURES) for item in data.recordings()]
    assert len(encoded) >= 4
    for item in encoded:
        assert isinstance(item, EncodedRecording)
        assert item.round_trip_mm is not None
        assert item.round_trip_mm < 5
        assert item.label.sentences
