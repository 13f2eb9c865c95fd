"""Seoul National University's capture: skeletons, names, annotations, splits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.recording import Dropped, Recording
from latentmotion.data.sources import LABELS
from latentmotion.data.sources.snu import (
    Group,
    LabeledSpan,
    find_takes,
    grouped,
    namings,
    read_annotations,
    recording_of,
    sentences_for,
    sentences_of,
    shows,
    snu_recordings,
)
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats.bvh import write_bvh
from latentmotion.kinematics.bone_names import find_joint_map, joint_maps
from latentmotion.kinematics.humanoid import to_humanml3d
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton
from tests.support.mocap_folders import swaying

COURT = joint_maps()["snu_court"]


def court(frames: int, seed: int = 0) -> Animation:
    """A walk on the skeleton of basketball, 30 frames per second."""
    walk = swaying(frames, 30.0, seed)
    names = tuple(str(next(iter(dict(_parts(COURT[name]))))) for name in HUMANML3D.names)
    skeleton = Skeleton("court", names, HUMANML3D.parents, HUMANML3D.offsets)
    return Animation(skeleton, walk.rotations, walk.root_positions, 30.0)


def _parts(source):
    return {source: 1.0} if isinstance(source, str) else source


def write_take(folder: Path, name: str, frames: int = 300, seed: int = 0) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_bvh(folder / f"{name}.bvh", court(frames, seed))


def block(file: str, start: int, end: int, action: str, include: str = "") -> str:
    lines = [f"file:{file}", f"startFrame:{start}", f"endFrame:{end}", f"include:{include}"]
    return "{\r\n\t" + "\r\n\t".join([*lines, f"type:{action}"]) + "\r\n},\r\n"


def recordings(folder: Path) -> list[Recording]:
    return [item for item in snu_recordings(folder) if isinstance(item, Recording)]


@pytest.mark.parametrize("name", [name for name in joint_maps() if name.startswith("snu_")])
def test_skeletons_are_known_by_their_names(name: str) -> None:
    names = {source for joint in joint_maps()[name].values() for source in _parts(joint)}
    assert find_joint_map(sorted(names)) == joint_maps()[name]


def test_joints_of_a_court_take_are_where_they_were() -> None:
    animation = court(40)
    np.testing.assert_allclose(to_humanml3d(animation), swaying(40, 30.0).joints(), atol=1e-6)


def test_a_take_becomes_pieces_at_20_frames_per_second(tmp_path: Path) -> None:
    write_take(tmp_path, "s_001_1_1")
    clips = recordings(tmp_path)
    assert sum(len(clip.joints) for clip in clips) == 200
    assert next(clip.label.id for clip in clips) == "snu-s_001_1_1-00000"


def test_every_person_of_a_take_shares_its_split(tmp_path: Path) -> None:
    for take in range(30):
        for person in (1, 2):
            write_take(tmp_path, f"s_900_{take}_{person}", 60, seed=2 * take + person)
    splits: dict[str, set[str]] = {}
    for clip in recordings(tmp_path):
        stem = clip.label.id[4:-6]
        splits.setdefault(recording_of(stem), set()).add(clip.label.split)
    assert len(splits) == 30
    assert all(len(found) == 1 for found in splits.values())
    assert set().union(*splits.values()) == {"train", "val", "test"}


@pytest.mark.parametrize(
    ("stem", "recording"),
    [
        ("s_006_1_3", "s_006_1"),
        ("multi__hys_box_2", "box_2"),
        ("multi__mmk_box_2", "box_2"),
        ("1__SSBoxerMan__high_five", "high_five"),
        ("1__walk_left_45degree", "walk_left_45degree"),
        ("wd2_u-turn_1", "wd2_u-turn_1"),
    ],
)
def test_recordings_are_known_by_name(stem: str, recording: str) -> None:
    assert recording_of(stem) == recording


def test_the_same_motion_under_another_name_is_dropped(tmp_path: Path) -> None:
    write_take(tmp_path, "a")
    write_take(tmp_path, "b")
    dropped = [item for item in snu_recordings(tmp_path) if isinstance(item, Dropped)]
    assert [(item.id, item.reason) for item in dropped] == [("b", "the same motion as a")]


def test_a_take_in_which_nothing_moves_is_dropped(tmp_path: Path) -> None:
    still = court(300)
    still.rotations[:], still.root_positions[:] = still.rotations[0], still.root_positions[0]
    write_bvh(tmp_path / "still.bvh", still)
    (dropped,) = list(snu_recordings(tmp_path))
    assert isinstance(dropped, Dropped)
    assert "nothing moves faster than" in dropped.reason


def test_annotated_stretches_become_clips_with_sentences(tmp_path: Path) -> None:
    write_take(tmp_path, "s_001_1_1")
    (tmp_path / "annotation").mkdir()
    text = block("s_001_1_1.bvh", 90, 119, "dribble") + block("s_001_1_1.bvh", 126, 150, "shoot")
    (tmp_path / "annotation" / "s_001_1.lab").write_text(text)
    told = [clip for clip in recordings(tmp_path) if clip.label.sentences]
    assert [clip.label.origin for clip in told] == [f"{tmp_path.name}/s_001_1_1.bvh[56:105]"]
    assert told[0].label.sentences[0].text == (
        "a person dribbles a basketball, then jumps and shoots a basketball at the hoop."
    )


def test_labels_marked_as_left_out_are(tmp_path: Path) -> None:
    (tmp_path / "annotation").mkdir()
    text = block("a.bvh", 1, 20, "pass", "false") + block("a.bvh", 30, 59, "pass")
    (tmp_path / "annotation" / "a.lab").write_text(text)
    assert read_annotations(tmp_path) == {"a": [LabeledSpan(30, 60, "pass")]}


def test_damaged_labels(tmp_path: Path) -> None:
    (tmp_path / "annotation").mkdir()
    (tmp_path / "annotation" / "a.lab").write_text("{\n file:a.bvh\n startFrame:x\n}")
    with pytest.raises(FileFormatError, match="expected frames in startFrame and endFrame"):
        read_annotations(tmp_path)


def test_short_and_close_stretches() -> None:
    spans = [
        LabeledSpan(100, 110, "pass"),
        LabeledSpan(150, 160, "walk"),
        LabeledSpan(165, 180, "run"),
    ]
    assert grouped(spans, 300) == [
        Group(93, 117, ("pass",)),
        Group(146, 184, ("walk", "run")),
    ]


def test_sentences_of_actions() -> None:
    assert sentences_of(["walk", "walk", "run"])[0] == "a person walks, then runs."
    assert sentences_of(["walk", "unheard of"]) == ()
    assert sentences_of([]) == ()
    assert all(phrase and phrase[-1] != "." for phrase in LABELS["snu"]["actions"].values())


def test_a_name_is_told_only_of_pieces_that_show_it() -> None:
    walk = swaying(100, 20).joints()
    stand = walk - (walk[:, :1] - walk[:1, :1])
    assert "a person walks forward fast." in sentences_for("wd2_WalkForwardFast00", walk, 0, True)
    assert sentences_for("wd2_WalkForwardFast00", stand, 0, True) == ()
    assert sentences_for("no_such_name", walk, 0, True) == ()


def test_every_row_of_the_names_can_be_checked_and_filled() -> None:
    joints = swaying(60, 20).joints()
    for naming in namings():
        needs = naming.needs.replace("{side}", "left")
        assert shows(needs, joints, 0.0, True) in (True, False)
        for sentence in naming.sentences:
            filled = sentence.format(side="left", by="90", pace="fast")
            assert filled.endswith(".") and "{" not in filled


def test_a_folder_of_something_else(tmp_path: Path) -> None:
    write_bvh(tmp_path / "walk.bvh", swaying(30))
    with pytest.raises(DataError, match="of SNU's skeletons"):
        find_takes(tmp_path)
    with pytest.raises(DataError, match="no folder"):
        find_takes(tmp_path / "nowhere")
