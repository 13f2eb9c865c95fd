"""Scene files and the command line's spelling of goals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from latentmotion.control.goals import Heading, LookAt, Pose, Reach, RootPath
from latentmotion.control.scene import (
    SCHEMA_FILE,
    Scene,
    parse_heading,
    parse_look,
    parse_path,
    parse_reach,
    read_scene,
)
from latentmotion.errors import InputError
from latentmotion.motion import Motion
from tests.support.schemas import json_schema
from tests.support.walker import walker


def test_the_published_schema_is_the_readers() -> None:
    assert json.loads(SCHEMA_FILE.read_text(encoding="utf-8")) == json_schema(Scene, "Scene")


def test_a_scene_becomes_goals(tmp_path: Path) -> None:
    Motion(walker(3).joints()).save(tmp_path / "stand.npz")
    content = {
        "format": 1,
        "prompt": "a person walks",
        "path": {"points": [[0, 0], [0, 2]], "at": [0, 3]},
        "goals": [{"joint": "head", "at": 1, "to": [0, None, 1.5], "until": 2}],
        "headings": [{"at": 3, "degrees": 10}],
        "looks": [{"at": 1, "to": [0, 1, 2]}],
        "poses": [{"at": 0, "file": "stand.npz", "frame": -1}],
    }
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    path, head, turned, look, pose = read_scene(file).all_goals(tmp_path)
    assert path == RootPath(((0.0, 0.0), (0.0, 2.0)), (0.0, 3.0))
    assert head == Reach("head", 1.0, (0.0, None, 1.5), 2.0)
    assert look == LookAt(1.0, (0.0, 1.0, 2.0))
    assert turned == Heading(3.0, 10.0)
    assert isinstance(pose, Pose)
    assert (pose.frame, len(pose.motion)) == (-1, 3)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"prompt": "walks"}, "missing key 'format'"),
        ({"format": 2}, "format 2, expected 1"),
        ({"format": 1, "promt": "walks"}, "unknown key 'promt'; did you mean 'prompt'"),
        ({"format": 1, "goals": [{"joint": "head", "at": 1}]}, "goals: missing key 'to'"),
        ({"format": 1, "goals": [{"joint": "head", "at": 1, "to": [1, 2]}]}, "3 values"),
        ({"format": 1, "path": {"points": [[0, "a"]]}}, "expected a number"),
    ],
)
def test_a_wrong_scene_is_refused(tmp_path: Path, content: object, reason: str) -> None:
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(InputError, match=reason):
        read_scene(file)


def test_goals_as_the_command_line_has_them() -> None:
    assert parse_reach("right_wrist@2.5=.3,_,2.1") == Reach("right_wrist", 2.5, (0.3, None, 2.1))
    assert parse_path("0,0@0 0,2@2") == RootPath([(0.0, 0.0), (0.0, 2.0)], [0.0, 2.0])
    assert parse_path("0,0 0,2") == RootPath([(0.0, 0.0), (0.0, 2.0)])
    assert parse_heading("90@2") == Heading(2.0, 90.0)
    assert parse_heading("-90@2-3.5") == Heading(2.0, -90.0, 3.5)
    held = Reach("right_hand", 0.5, (-0.4, 0.0, None), 4.0, "left_hand")
    assert parse_reach("right_hand@.5-4=left_hand:-.4,0,_") == held
    assert parse_look("2,1.6,-2@1-3") == LookAt(1.0, (2.0, 1.6, -2.0), 3.0)
    assert parse_path("0,0 0,2", (1.2,)) == RootPath([(0.0, 0.0), (0.0, 2.0)], None, (1.2,))


@pytest.mark.parametrize("text", ["right_wrist", "head@1=1,2", "head@x=1,2,3", "head@1=1,a,3"])
def test_a_wrong_reach_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="JOINT@SECONDS"):
        parse_reach(text)


@pytest.mark.parametrize("text", ["0,0 1", "0,0@0 0,2", "0,0@a 1,1@2"])
def test_a_wrong_path_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--path"):
        parse_path(text)
