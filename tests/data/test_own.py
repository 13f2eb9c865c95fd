from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import formats
from latentmotion.cli.main import main
from latentmotion.data.clip import Source
from latentmotion.data.prepare import Preparation, encode_all
from latentmotion.data.recording import Dropped, Recording, files_below
from latentmotion.data.sources.own import OwnMotions
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats.bvh import write_bvh
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton
from latentmotion.kinematics.standing import Stated
from latentmotion.motion import Motion
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.captioning.described import captions_of_names
from tests.support.mocap_folders import swaying, with_t_pose, write_own

SOURCE = Source("own", "mine", "me")


def labels(motions: OwnMotions) -> dict:
    return {i.label.id: i.label for i in motions.recordings() if isinstance(i, Recording)}


def test_captions_beside_the_files(tmp_path: Path) -> None:
    write_own(tmp_path, ["walk", "deep/turn"])
    (tmp_path / "walk.txt").write_text("a person walks left\nhe stops#he/PRON#1.0#2.0\n")
    found = labels(OwnMotions(tmp_path, SOURCE))
    assert [s.text for s in found["walk"].sentences] == ["a person walks left", "he stops"]
    assert found["walk"].mirrored_sentences[0].text == "a person walks right"
    assert found["walk"].sentences[1].end == 2.0
    assert found["deep-turn"].sentences == ()


def test_babels_labels(tmp_path: Path) -> None:
    write_own(tmp_path / "amass", ["CMU/05/walk", "CMU/05/turn"])
    part = {"raw_label": "turn left", "act_cat": ["turn"], "start_t": 0.5, "end_t": 1.5}
    rest = {"raw_label": "transition", "start_t": 1.5, "end_t": 2.0}
    content = {
        "7": {"feat_p": "CMU/CMU/05/walk.npz", "seq_ann": {"labels": [{"raw_label": "walks"}]}},
        "8": {"feat_p": "CMU/05/turn.npz", "frame_ann": {"labels": [part, rest]}, "seq_ann": None},
        "9": {"feat_p": "KIT/KIT/3/gone.npz", "seq_ann": {"labels": [{"raw_label": "goes"}]}},
    }
    (tmp_path / "val.json").write_text(json.dumps(content))
    motions = OwnMotions(tmp_path / "amass", SOURCE, tmp_path / "val.json")
    found = {
        name: (label.split, [(s.text, s.start, s.end) for s in label.sentences])
        for name, label in labels(motions).items()
    }
    assert found == {
        "CMU-05-walk": ("val", [("walks", 0, 0)]),
        "CMU-05-turn": ("val", [("turn left", 0.5, 1.5)]),
    }
    (lost,) = (item for item in motions.recordings() if isinstance(item, Dropped))
    assert lost.id == "KIT/3/gone" and "not there: goes" in lost.reason
    for bad in ([1], {"7": 3}, {"7": {"feat_p": "a", "seq_ann": {"labels": [{}]}}}):
        (tmp_path / "val.json").write_text(json.dumps(bad))
        with pytest.raises(FileFormatError, match="no labels of BABEL"):
            list(motions.recordings())


def test_a_table_of_captions(tmp_path: Path) -> None:
    write_own(tmp_path, ["walk", "turn"])
    table = tmp_path / "captions.csv"
    table.write_text(
        "file,caption,from,to,split,action\n"
        "walk.bvh,he walks,,,val,walking\n"
        "walk,he stops,1,2.5,,\n"
        "gone.bvh,he is gone,,,,\n"
    )
    items = list(OwnMotions(tmp_path, SOURCE, table).recordings())
    dropped = [item for item in items if isinstance(item, Dropped)]
    assert [(d.id, d.what) for d in dropped] == [("gone.bvh", "caption")] or dropped[0].id == "gone"
    label = labels(OwnMotions(tmp_path, SOURCE, table))["walk"]
    assert (label.split, label.action) == ("val", "walking")
    assert [(s.text, s.start, s.end) for s in label.sentences] == [
        ("he walks", 0, 0),
        ("he stops", 1, 2.5),
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,words\n", r"lacks the column file, caption; found name, words"),
        ("", "found nothing"),
        ("file,caption,split\nwalk,he walks,training\n", r":2: split 'training'.*train, val"),
        ("file,caption,from,to\nwalk,he walks,a,b\n", r":2: expected seconds"),
    ],
)
def test_tables_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    write_own(tmp_path, ["walk"])
    (tmp_path / "captions.csv").write_text(text)
    with pytest.raises(DataError, match=message):
        list(OwnMotions(tmp_path, SOURCE, tmp_path / "captions.csv").recordings())


def test_missing_folder_table_and_files(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no folder"):
        list(OwnMotions(tmp_path / "none", SOURCE).recordings())
    with pytest.raises(DataError, match="found none"):
        list(OwnMotions(tmp_path, SOURCE).recordings())
    write_own(tmp_path, ["walk"])
    with pytest.raises(DataError, match=r"no file .*columns file, caption"):
        list(OwnMotions(tmp_path, SOURCE, tmp_path / "captions.csv").recordings())


def test_the_rate_given_beats_the_file(tmp_path: Path) -> None:
    write_own(tmp_path, ["walk"], fps=60.0)
    for fps, step in ((None, 3), (20.0, 1)):
        (item,) = OwnMotions(tmp_path, SOURCE, stated=Stated(fps=fps)).recordings()
        assert isinstance(item, Recording)
        expected = swaying(150, 60.0).joints()[::step]
        np.testing.assert_allclose(item.joints, expected, atol=1e-4)


def test_unknown_skeletons_need_a_map(tmp_path: Path) -> None:
    names = tuple(f"bone{n}" for n in range(len(HUMANML3D)))
    skeleton = Skeleton("odd", names, HUMANML3D.parents, HUMANML3D.offsets)
    animation = swaying(60, 20.0)
    odd = Animation(skeleton, animation.rotations, animation.root_positions, 20.0)
    write_bvh(tmp_path / "walk.bvh", odd)
    (item,) = OwnMotions(tmp_path, SOURCE).recordings()
    assert isinstance(item, Dropped)
    assert "unknown names" in item.reason
    path = tmp_path / "map.json"
    path.write_text(json.dumps(dict(zip(HUMANML3D.names, names, strict=True))))
    (item,) = OwnMotions(
        tmp_path, SOURCE, stated=Stated(joint_maps=(load_joint_map(path),))
    ).recordings()
    assert isinstance(item, Recording)
    np.testing.assert_allclose(item.joints, animation.joints(), atol=1e-4)


def test_splits_do_not_depend_on_other_files(tmp_path: Path) -> None:
    names = [f"take{n}" for n in range(6)]
    write_own(tmp_path, names)
    few = labels(OwnMotions(tmp_path, SOURCE, val=0.3, test=0.3))
    write_own(tmp_path, ["another"])
    more = labels(OwnMotions(tmp_path, SOURCE, val=0.3, test=0.3))
    assert all(few[name].split == more[name].split for name in names)


def test_files_are_found_behind_links_which_may_lead_back(tmp_path: Path) -> None:
    (tmp_path / "disk" / "deep").mkdir(parents=True)
    (tmp_path / "data").mkdir()
    for name in ("a.BVH", "b.txt", "deep/c.npz"):
        (tmp_path / "disk" / name).touch()
    (tmp_path / "data" / "link").symlink_to(tmp_path / "disk")
    (tmp_path / "disk" / "back").symlink_to(tmp_path / "data")
    found = files_below(tmp_path / "data", [".bvh", ".npz"])
    assert [path.relative_to(tmp_path / "data").as_posix() for path in found] == [
        "link/a.BVH",
        "link/deep/c.npz",
    ]


def test_motions_of_a_model_are_named_and_left_out_unless_asked_for(tmp_path: Path) -> None:
    write_own(tmp_path, ["walk"])
    joints = swaying(60, 20.0).joints().astype(np.float32)
    made = Motion(joints, 20.0, metadata={"model": "fast"})
    formats.save(tmp_path / "take.npz", [made])
    formats.save(tmp_path / "mocap.npz", [Motion(joints, 20.0)])
    assert set(labels(OwnMotions(tmp_path, SOURCE))) == {"walk", "take", "mocap"}
    items = list(OwnMotions(tmp_path, SOURCE, generated=False).recordings())
    (dropped,) = (item for item in items if isinstance(item, Dropped))
    assert dropped.id == "take"
    assert "'fast'" in dropped.reason
    assert "--generated" in dropped.reason


# What is cut away, and what is left


def prepared(folder: Path) -> tuple[list[Recording], list[Dropped]]:
    items = list(OwnMotions(folder, SOURCE).recordings())
    dropped = [item for item in items if isinstance(item, Dropped)]
    return [item for item in items if isinstance(item, Recording)], dropped


def write_jumping(path: Path, frames: int, at: int) -> np.ndarray:
    """A file at 20 fps that jumps by a meter in one frame."""
    animation = swaying(frames, 20.0)
    animation.root_positions[at:] += (0, 0, 1.0)
    write_bvh(path, animation)
    return animation.joints()


def test_a_t_pose_in_frame_0_goes(tmp_path: Path) -> None:
    animation = with_t_pose(swaying(60, 20.0))
    write_bvh(tmp_path / "walk.bvh", animation)
    (item,), dropped = prepared(tmp_path)
    assert not dropped
    np.testing.assert_allclose(item.joints, animation.joints()[1:], atol=1e-4)


def test_a_jump_cuts_a_file_in_two(tmp_path: Path) -> None:
    joints = write_jumping(tmp_path / "walk.bvh", 100, 70)
    (tmp_path / "walk.txt").write_text(
        "a person walks\nhe turns#he/PRON#0.5#1.5\nhe stops#he/PRON#4.0#5.0\n"
    )
    items, (part, *captions) = prepared(tmp_path)
    assert [item.label.id for item in items] == ["walk", "walk-part2"]
    assert [len(item.joints) for item in items] == [67, 27]
    np.testing.assert_allclose(items[1].joints, joints[73:], atol=1e-4)
    said = [[(s.text, s.start, s.end) for s in item.label.sentences] for item in items]
    assert said[0] == [("a person walks", 0, 0), ("he turns", 0.5, 1.5)]
    assert said[1] == [("he stops", pytest.approx(0.35), pytest.approx(1.35))]
    assert items[1].label.start == pytest.approx(3.65)
    assert part.what == "part" and part.reason.startswith("6 of 100 frames: ")
    assert not captions


def test_a_part_of_less_than_half_is_not_what_the_file_shows(tmp_path: Path) -> None:
    animation = swaying(100, 20.0)
    for at in (30, 65):
        animation.root_positions[at:] += (0, 0, 1.0)
    write_bvh(tmp_path / "walk.bvh", animation)
    (tmp_path / "walk.txt").write_text("a person walks\n")
    items, dropped = prepared(tmp_path)
    assert len(items) == 3 and not any(item.label.sentences for item in items)
    assert [item.what for item in dropped] == ["part", "caption", "caption", "caption"]


def test_where_nothing_is_left_the_reasons_are_told(tmp_path: Path) -> None:
    for n in range(12):
        animation = swaying(40, 20.0)
        animation.root_positions[::4] += (0, 0, 1.0 + n)
        write_bvh(tmp_path / f"take{n:02}.bvh", animation)
    encoded = encode_all(OwnMotions(tmp_path, SOURCE).recordings(), HUMANML3D_FEATURES)
    preparation = Preparation(HUMANML3D_FEATURES)
    preparation.add(encoded)
    with pytest.raises(DataError) as error:
        preparation.write(tmp_path / "out", (SOURCE,))
    said = str(error.value)
    assert said.count("pelvis jumps") + said.count("the body moves") == 10
    assert said.endswith("; 2 more reasons)")


def test_animations_of_a_glb_are_takes(tmp_path: Path) -> None:
    takes = [Motion(swaying(60, 20.0, seed).joints().astype("f4")) for seed in (0, 1)]
    formats.save(tmp_path / "walk.glb", takes)
    items, dropped = prepared(tmp_path)
    assert [item.label.id for item in items] == ["walk-1", "walk-2"] and not dropped
    np.testing.assert_allclose(items[1].joints, takes[1].joints, atol=1e-4)


def test_takes_of_an_npz_are_clips(tmp_path: Path) -> None:
    takes = [Motion(swaying(frames).joints()) for frames in (40, 50)]
    formats.save(tmp_path / "takes.npz", takes)
    found = list(OwnMotions(tmp_path, SOURCE).recordings())
    assert [(r.label.id, len(r.joints)) for r in found if isinstance(r, Recording)] == [
        ("takes-1", 40),
        ("takes-2", 50),
    ]


def test_a_draft_is_of_the_first_unknown_skeleton(tmp_path: Path) -> None:
    write_own(tmp_path, ["known"])
    motions = OwnMotions(tmp_path, SOURCE)
    assert motions.unknown_skeleton() is None
    animation = swaying(20, 20.0)
    names = tuple(f"bone{n}" for n in range(len(HUMANML3D)))
    odd = replace(animation, skeleton=replace(HUMANML3D, names=names))
    write_bvh(tmp_path / "odd.bvh", odd)
    skeleton = motions.unknown_skeleton()
    assert skeleton is not None and set(names) <= set(skeleton.names)
    draft, said = tmp_path / "map.json", ["data", "prepare", "own", str(tmp_path)]
    main([*said, "-o", str(tmp_path / "out"), "--draft-map", str(draft)])
    assert not (tmp_path / "out").exists()
    with_map = OwnMotions(tmp_path, SOURCE, stated=Stated(joint_maps=(load_joint_map(draft),)))
    dropped = [item for item in with_map.recordings() if isinstance(item, Dropped)]
    assert [item.id for item in dropped] == []


def test_names_of_files_become_sentences() -> None:
    found = captions_of_names(
        ["dataset-1_bow_angry_001.bvh", "b/dataset-1_wave_002.bvh", "dataset-1_leftKick_003.bvh"]
    )
    assert list(found.values()) == [
        "a person bows angrily",
        "a person waves",
        "a person kicks left",
    ]
    mixed = ["bvh_test.bvh", "jesse_dance.bvh", "WalkForward.fbx", "walk_and_wave.glb", "idle.bvh"]
    assert list(captions_of_names(mixed).values()) == [
        *("", "a person dances", "a person walks forward", "a person walks and waves", "idle"),
    ]
    alike = captions_of_names(["walk_01.bvh", "walk_02.bvh"])
    assert set(alike.values()) == {"a person walks"}


def test_a_caption_without_an_end_lasts_until_the_end(tmp_path: Path) -> None:
    write_own(tmp_path, ["walk"])
    table = tmp_path / "captions.csv"
    table.write_text("file,caption,from,to\nwalk.bvh,he waves,1.5,\n")
    (item,) = OwnMotions(tmp_path, SOURCE, table).recordings()
    assert isinstance(item, Recording)
    (sentence,) = item.label.sentences
    assert sentence.start == 1.5 and sentence.end == pytest.approx(len(item.joints) / 20)
