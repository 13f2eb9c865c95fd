"""Windows of single actions: made-up motions, and the benchmark's own checks on real ones."""

from __future__ import annotations

import re
import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.instructions import parse, refused_captions
from latentmotion.data.recording import Recording
from latentmotion.data.sources.hdm05 import hdm05_groups
from latentmotion.data.store import StoredClip
from latentmotion.measure.facts import SingleAction
from latentmotion.measure.scene import describe
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.captioning.described import without_captions
from latentmotion.training.captioning.single_actions import LONGEST, SHORTEST, single_actions
from latentmotion.training.captioning.singles import Found, category_of, with_prompts
from latentmotion.training.checking import fulfills
from tests.support.simple_motions import FPS, figure, mirrored, raised

_OTHER = {"left": "right", "right": "left"}


def found_in(joints: np.ndarray, seed: int = 0) -> list[SingleAction]:
    return single_actions(joints, np.random.default_rng(seed))


def standing_then(joints: np.ndarray, seconds: float = 1.0) -> np.ndarray:
    still = np.repeat(joints[:1], round(seconds * FPS), axis=0)
    return np.concatenate([still, joints, np.repeat(joints[-1:], round(seconds * FPS), axis=0)])


def expression(action: SingleAction) -> str:
    """What the benchmark demands of a motion with this action; empty where it has no such act."""
    side, count, degrees = action.side, action.count, action.degrees
    counted = {"kick", "punch", "squat", "jack", "clap"}
    if action.kind in counted:
        given = f"{side}, {count}" if side in _OTHER else f"any, {count}" if side else f"{count}"
        return f"{action.kind}({given})"
    if action.kind == "turn":
        return f"turn({side}, {0.8 * degrees - 5}, {1.2 * degrees + 5})"
    known = {
        "jump": f"jump({count})",
        "hop": f"hop({side}, {count})",
        "knee": f"knee_up({side if side in _OTHER else 'any'}, {count})",
        "raise": f"raise({side}, {count})",
        "wave": f"wave({side})",
        "steps": f"step({count}, {count})",
        "balance": f"one_leg({side})",
        "touch_head": f"touch({side}, head)",
        "circle": f"turn({side}, 270, 4000) & travel(2)",
        "half_circle": f"turn({side}, 120, 240) & travel(1)",
        "march": "in_place(0.8) & lift_feet(3, 99)",
        "pick_up": "reach_down",
        "sit_down": "sit",
        "lie_down": "lie",
        "stand_up": "sit > stand",
        "get_up": "low > stand",
        "stop_walking": "walk > halt",
        "walk_to_run": "walk > run",
        "run_to_walk": "run > walk",
        "walk": f"move({action.direction}, 0.3) & facing(30)",
        "run": "travel(1) & speed(2, 9)",
        "speed_up": "faster(1.3)",
        "slow_down": "slower(1.3)",
        "weave": "weave(20) & travel(1.5)",
        "sneak": "stooped & travel(0.5)",
        "stand": "still(0.7)",
    }
    same = {"sit", "lie", "sit_floor", "kneel", "crouch", "crawl", "arms_out", "hands_on_hips"}
    return action.kind if action.kind in same else known.get(action.kind, "")


@pytest.mark.parametrize(("turn", "side"), [(90, "left"), (-90, "right")])
def test_a_walked_turn_has_the_net_degrees_of_its_window(turn: float, side: str) -> None:
    joints = figure(4, speed=1.0, turn=turn)
    turns = [action for action in found_in(joints) if action.kind == "turn"]
    assert turns
    for action in turns:
        heading = describe(joints[action.start : action.end]).signals.heading
        assert (action.side, action.gait) == (side, "walk")
        assert action.degrees == pytest.approx(abs(np.degrees(heading[-1] - heading[0])), abs=1)


@pytest.mark.parametrize(
    ("way", "direction"), [(0, "forward"), (180, "backward"), (90, "left"), (-90, "right")]
)
def test_a_straight_walk_has_its_direction_and_pace(way: float, direction: str) -> None:
    found = [one for one in found_in(figure(5, speed=0.5, way=way)) if one.kind == "walk"]
    assert found
    assert {(one.direction, one.pace) for one in found} == {(direction, "slow")}


def test_jumps_are_counted_exactly() -> None:
    time = np.arange(140) / FPS
    phase = time % 2.0
    up = np.where((phase > 0.7) & (phase < 1.2), 5.6 * (phase - 0.7) * (1.2 - phase), 0.0)
    jumps = [one for one in found_in(figure(7, height=0.92 + up)) if one.kind == "jump"]
    assert {one.count for one in jumps} >= {1, 2}
    for one in jumps:
        tops = [30 * n + 19 + 10 * n for n in range(4)]
        assert one.count == sum(one.start <= top < one.end for top in tops)


@pytest.mark.parametrize(("side", "axis"), [("left", 2.6), ("right", -2.6)])
def test_a_raised_hand_is_one_action_and_mirrors(side: str, axis: float) -> None:
    joints = standing_then(figure(3, swings={f"{side}_shoulder": raised(60, axis)}))
    raises = [one for one in found_in(joints) if one.kind == "raise"]
    assert raises
    assert {one.side for one in raises} == {side}
    other = [one for one in found_in(mirrored(joints)) if one.kind == "raise"]
    assert [replace(one, side=_OTHER[one.side]) for one in other] == raises


def test_both_hands_up_are_not_one_hand() -> None:
    swings = {"left_shoulder": raised(60, 2.6), "right_shoulder": raised(60, -2.6)}
    found = found_in(standing_then(figure(3, swings=swings)))
    assert {one.side for one in found if one.kind == "raise"} == {"both"}


def test_who_waves_and_walks_does_neither_alone() -> None:
    joints = figure(4, speed=1.0, swings={"left_shoulder": raised(80, 2.6)})
    assert not [one for one in found_in(joints) if one.kind in ("raise", "wave")]


def test_windows_have_whole_units_and_fit_a_model() -> None:
    for action in found_in(figure(12, speed=1.0, turn=200)):
        assert SHORTEST <= action.frames <= LONGEST
        assert action.frames % 4 == 0
        assert 0 <= action.start < action.end <= 240


def test_categories_take_left_and_right_as_one() -> None:
    one = SingleAction("kick", 0, 20, "left", "forward", 2)
    assert category_of(one) == category_of(replace(one, side="right"))
    assert category_of(one) != category_of(replace(one, count=1))


def test_prompts_go_with_their_mirror_images() -> None:
    clip = StoredClip("a", "own", "a", "train", 40, 0, 0, (), ())
    told = with_prompts(clip, {"a": [("kick with the left leg", 4, 24)]})
    assert told.captions == (("kick with the left leg", 4, 24, ""),)
    assert told.mirrored_captions == (("kick with the right leg", 4, 24, ""),)
    assert with_prompts(clip, {}) == clip


def test_the_benchmark_finds_what_windows_of_real_clips_are_said_to_show(
    shared: Path, tmp_path: Path
) -> None:
    """Clips of HDM05: kicks, squats, jumps, knees, sneaking, circles, things put on the floor."""
    with tarfile.open(shared / "data/hdm05_asfamc.tar.xz") as tar:
        for member in tar:
            if member.name.endswith(".asf") or re.search(r"_00[1-4]_120\.amc$", member.name):
                tar.extract(member, tmp_path, filter="data")
    checked = 0
    for item in hdm05_groups(tmp_path)[0].read():
        assert isinstance(item, Recording)
        joints = HUMANML3D_FEATURES.canonicalize(HUMANML3D_FEATURES.retarget(item.joints))
        for action in found_in(joints):
            check = expression(action)
            if check:
                scene = describe(joints[action.start : action.end])
                assert fulfills(scene, parse(check)), (item.label.id, action, check)
                checked += 1
    assert checked > 50


def test_found_names_its_clip() -> None:
    action = SingleAction("walk", 0, 40)
    assert Found("a", action) == Found("a", action)


def test_a_test_sets_sentences_are_no_captions(tmp_path: Path) -> None:
    refused = refused_captions()
    assert {"turn left", "turn right", "sit down"} <= refused
    rows = (("Turn left.", 0, 40, ""), ("a man turns to the left", 0, 40, ""))
    clip = StoredClip("a", "cmu", "", "train", 40, 0, 0, rows, rows)
    left = without_captions(clip, refused)
    assert left.captions == left.mirrored_captions == rows[1:]
    assert without_captions(replace(clip, split="test"), refused).captions == rows
