"""Clips of a state machine: one pose, loops in step, speeds as asked, events; the command."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.cleanup.loops import turn_of
from latentmotion.cli.main import main
from latentmotion.control.states import State, generate_states, parse_state
from latentmotion.errors import InputError
from latentmotion.formats.engines import write_unity
from latentmotion.formats.gltf_reader import read_animations
from latentmotion.formats.tables import contact_events
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn
from tests.support.walker import walker


@pytest.fixture(scope="module")
def clips() -> dict[str, Motion]:
    generate = MotionPipeline.from_pretrained("fast", "onnxruntime", 1)
    states = map(parse_state, ("idle", "walk@1.3", "turn left 90"))
    return {clip.metadata["state"]: clip for clip in generate_states(generate, [*states], takes=2)}


def test_words_of_states() -> None:
    assert parse_state("walk@1.4") == State("walk", "a person walks forward", True, 1.4)
    right = parse_state("turn right 180")
    assert (right.degrees, right.prompt) == (-180, "a person turns 180 degrees to the right")
    assert parse_state("hop=loop: a person hops") == State("hop", "a person hops", True)
    assert parse_state("bow=a person bows") == State("bow", "a person bows")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("wlk", "did you mean 'walk'"),
        ("walk@fast", "expected a number"),
        ("walk@30", "up to 8 m/s"),
        ("jump@2", "of a loop"),
        ("turn left 900", "up to 360"),
        ("bow=", "expected a name and a sentence"),
    ],
)
def test_wrong_states_are_refused(text: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        parse_state(text)


def test_single_moves_begin_and_end_in_the_pose_of_the_idle_loop(clips: dict[str, Motion]) -> None:
    pose = clips["idle"].joints[0].astype(float)
    move = clips["turn left 90"].joints.astype(float)
    assert np.abs(move[0] - pose).max() < 0.01
    facing = heading(move[-1], clips["idle"].skeleton)
    back = turn(move[-1] - move[-1, 0] * (1, 0, 1), -facing)
    assert np.abs(back - (pose - pose[0] * (1, 0, 1))).max() < 0.01
    assert clips["turn left 90"].metadata["degrees"] == pytest.approx(90, abs=0.5)


def test_loops_close_and_travel_at_their_speed(clips: dict[str, Motion]) -> None:
    for name, speed in (("idle", 0.0), ("walk", 1.3)):
        angle, step = turn_of(clips[name])
        assert abs(angle) < 0.01
        there = np.linalg.norm(step) * 20 / (len(clips[name]) - 1)
        assert there == pytest.approx(speed, abs=0.02)
        closed = clips[name].joints[-1] - clips[name].joints[0] - step
        assert np.abs(closed).max() < 1e-3
    names, first = clips["walk"].skeleton.names, clips["walk"].joints[0]
    ahead = first[names.index("left_ankle"), 2] - first[names.index("right_ankle"), 2]
    assert ahead > 0.2  # the left foot is ahead
    downs = [e["event"] for e in clips["walk"].metadata["events"] if e["event"].endswith("down")]
    assert sorted(downs) == ["left_foot_down"] * 2 + ["right_foot_down"] * 2


def test_events_are_those_of_contacts() -> None:
    joints = np.repeat(walker(1).joints(), 60, axis=0)
    joints[..., 1] -= joints[..., 1].min()
    lifted = [7, 10]
    joints[20:40, lifted, 1] += 0.3
    events = contact_events(Motion(joints))
    assert [e["event"] for e in events] == ["left_foot_up", "left_foot_down"]
    assert events[0]["time"] == pytest.approx(1.0, abs=0.11)
    assert events[1]["time"] == pytest.approx(2.0, abs=0.11)


def test_the_command_writes_clips_events_and_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "hero.glb"
    main(["set", "-o", str(output), "--states", "idle", "walk", "--takes", "2", "--threads", "1"])
    assert "walk: " in capsys.readouterr().out
    first, second = read_animations(output)
    assert (first.skeleton.names[0], first.fps) == ("Root", 30)
    assert np.linalg.norm(np.ptp(second.root_positions, axis=0)) > 1
    assert np.ptp(first.root_positions, axis=0).max() < 0.02
    table = json.loads(output.with_suffix(".set.json").read_text(encoding="utf-8"))
    assert [clip["state"] for clip in table["clips"]] == ["idle", "walk"]
    assert all(clip["loop"] for clip in table["clips"])
    rows = list(csv.DictReader(output.with_suffix(".events.csv").read_text().splitlines()))
    assert {row["clip"] for row in rows} == {"walk"}
    document = output.read_bytes()
    assert b'"left_foot_down"' in document and b'"name":"walk"' in document
    with pytest.raises(SystemExit):
        main(["set", "-o", str(tmp_path / "hero"), "--preset", "mixamo"])
    assert "a folder is for --preset godot or unity" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["set", "-o", str(output), "--states", "idle", "idle"])
    assert "two states are called 'idle'" in capsys.readouterr().err


def test_a_folder_for_godot_has_loops_root_motion_and_events(tmp_path: Path) -> None:
    folder = tmp_path / "hero"
    words = ["--states", "idle", "walk", "--takes", "2", "--threads", "1"]
    main(["set", "-o", str(folder), "--preset", "godot", *words])
    settings = (folder / "hero.glb.import").read_text(encoding="utf-8")
    loops = json.loads(settings.partition("_subresources=")[2])["animations"]
    assert loops == {name: {"settings/loop_mode": 1} for name in ("idle", "walk")}
    script = (folder / "hero.gd").read_text(encoding="utf-8")
    assert 'const ROOT := "Root"' in script and '$Figure.find_children("*"' in script
    (events,) = re.findall(r"const EVENTS := (.*)", script)
    table = json.loads((folder / "hero.set.json").read_text(encoding="utf-8"))
    expected = [[e["time"], e["event"]] for e in table["clips"][1]["events"]]
    assert json.loads(events)["walk"] == [[pytest.approx(t, abs=1e-4), e] for t, e in expected]
    assert 'path="hero.glb"' in (folder / "hero.tscn").read_text(encoding="utf-8")


def test_a_script_for_unity_names_clips_loops_and_events(tmp_path: Path) -> None:
    events = [{"time": 0.5, "event": "left_foot_down"}]
    clips = [
        {"state": "walk", "loop": True, "seconds": 2.0, "events": events},
        {"state": "jump", "loop": False, "seconds": 1.0, "events": []},
    ]
    (path,) = write_unity(tmp_path / "my hero.fbx", clips, "Root")
    script = path.read_text(encoding="utf-8")
    assert path == tmp_path / "Editor" / "my heroImport.cs" and "class Import_my_hero :" in script
    assert 'name = "walk", loops = true, times = new float[] { 0.25000f },' in script
    assert 'what = new string[] { "left_foot_down" }' in script
    assert 'name = "jump", loops = false, times = new float[] {  },' in script
    assert "$" not in script and script.count("{") == script.count("}")
