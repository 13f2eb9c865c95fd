from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.clip import Source
from latentmotion.data.recording import Dropped, Recording, files_below
from latentmotion.data.sources.own import OwnMotions
from latentmotion.errors import DataError
from latentmotion.formats.bvh import write_bvh
from latentmotion.kinematics.humanoid import load_joint_map
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton
from tests.support.mocap_folders import swaying, write_own

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
        (item,) = OwnMotions(tmp_path, SOURCE, fps=fps).recordings()
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
    (item,) = OwnMotions(tmp_path, SOURCE, joint_map=load_joint_map(path)).recordings()
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
