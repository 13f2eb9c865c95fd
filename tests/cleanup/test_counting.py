"""Exact counts: what is asked, what is left as it is, and that what is made is smooth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.cleanup import CleanUp
from latentmotion.cleanup.counting import Count
from latentmotion.describe.repetitions import repetitions
from latentmotion.kinematics.plausibility import jitter
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import cleaned
from tests.support import acted


def asks(joints: np.ndarray, act: object, times: object, side: object = "") -> Motion:
    count = {"act": act, "side": side, "times": times}
    return Motion(joints.astype(np.float32), metadata={"count": count})


def counted(motion: Motion, act: str, side: str = "") -> int:
    found = repetitions(motion.joints.astype(np.float64), act, side)
    return len(found.full) if found else 0


@pytest.mark.parametrize(
    ("joints", "act", "side", "made", "times"),
    [
        (acted.jump(2), "jump", "", 2, 3),
        (acted.jump(4), "jump", "", 4, 2),
        (acted.kick("left", 1), "kick", "left", 1, 3),
        (acted.kick("right", 3), "kick", "", 3, 2),
        (acted.knee_up("left", 2), "knee", "left", 2, 3),
        (acted.hop("right", 4), "hop", "right", 4, 3),
        (acted.squat(1), "squat", "", 1, 2),
        (acted.bow(3), "bow", "", 3, 1),
        (acted.jack(2), "jack", "", 2, 4),
        (acted.raise_hand("left", 1), "raise", "left", 1, 2),
    ],
)
def test_it_is_done_as_often_as_asked(
    joints: np.ndarray, act: str, side: str, made: int, times: int
) -> None:
    motion = asks(joints, act, times, side)
    plain, exact = motion.cleaned(CleanUp(exact_count=False)), motion.cleaned()
    assert counted(plain, act, side) == made and plain.metadata == motion.metadata
    assert counted(exact, act, side) == times and exact.metadata["count"]["made"] == made
    assert (len(exact) > len(plain)) == (times > made)
    assert jitter(exact.joints, 20.0) < 1.5 * jitter(plain.joints, 20.0)


@pytest.mark.parametrize(
    ("act", "times", "side"),
    [("jump", 2, ""), ("kick", 2, ""), ("jump", 19, ""), ("juggle", 3, ""), ("jump", 0, ""),
     ("jump", True, "up"), ("jump", 2.5, ""), ("jump", "3", ""), (["jump"], 3, ""),
     ("jump", 99, ""), ("jump", None, "")],
)  # fmt: skip
def test_other_motions_are_left_as_they_are(act: object, times: object, side: object) -> None:
    joints = acted.jump(2)
    motion = asks(joints, act, times, side)
    assert np.array_equal(motion.cleaned().joints, Motion(motion.joints).cleaned().joints)
    assert motion.cleaned().metadata == motion.metadata


def test_an_act_of_the_other_side_is_left_as_it_is() -> None:
    kicks = acted.in_sequence(acted.kick("left", 1), acted.kick("right", 1))
    assert "made" not in asks(kicks, "kick", 2, "left").cleaned().metadata["count"]


def test_half_a_repetition_is_neither_counted_nor_repeated() -> None:
    part = acted.bump(30, 7.5, 15, 22.5)[:, None] * np.array([0.0, 0.33, 0.4])
    swing = acted.Body(frames=30, feet={"left": part}).joints()
    kicks = acted.in_sequence(acted.kick("left", 1), swing)
    found = repetitions(kicks, "kick")
    assert found and (len(found.full), len(found.weak)) == (1, 1)
    exact = asks(kicks, "kick", 3).cleaned()
    found = repetitions(exact.joints.astype(np.float64), "kick")
    assert found and (len(found.full), found.weak) == (3, ())


@pytest.mark.parametrize("count", [7, {}, [90], {"act": {}}, {"act": "jump", "times": 2}])
def test_odd_metadata_ask_for_nothing(count: Any) -> None:
    assert Count.of({"count": count}) is None


def test_a_path_goes_on_the_way_that_the_body_faces() -> None:
    motion = asks(acted.elsewhere(acted.jump(2, speed=1.0), 70.0), "jump", 3)
    plain, exact = motion.cleaned(CleanUp(exact_count=False)), motion.cleaned()
    one, other = (m.joints[-1, 0] - m.joints[0, 0] for m in (plain, exact))
    assert np.hypot(one[0], one[2]) + 0.3 < np.hypot(other[0], other[2])
    assert np.degrees(np.arctan2(other[0], other[2]) - np.arctan2(one[0], one[2])) % 360 < 15


@pytest.mark.parametrize("steps", [CleanUp(), CleanUp(in_place=True)])
def test_a_motion_beside_one_with_a_count_is_what_it_is_alone(steps: CleanUp) -> None:
    motions = [Motion(acted.kick("left", 2).astype(np.float32)), asks(acted.jump(2), "jump", 3)]
    for alone, together in zip(motions, cleaned(motions, steps), strict=True):
        assert np.array_equal(alone.cleaned(steps).joints, together.joints)


def test_it_is_made_once_in_place_and_forgotten_in_parts() -> None:
    motion = asks(acted.jump(2, speed=1.0), "jump", 3)
    exact = motion.cleaned()
    again = exact.cleaned()
    assert len(again) == len(exact) and again.metadata == exact.metadata
    assert "count" not in exact.cut(0, 1).metadata and "count" not in exact.mirrored().metadata
    placed = motion.cleaned(CleanUp(in_place=True))
    assert len(placed) == len(exact)
    assert np.abs(placed.joints[:, 0, [0, 2]]).max() < 0.3 < np.ptp(exact.joints[:, 0, 2])


def test_together_as_alone_and_other_skeletons() -> None:
    motions = [asks(acted.jump(n), "jump", 2) for n in (1, 2, 3)]
    for one, alone in zip(cleaned(motions), motions, strict=True):
        assert np.array_equal(one.joints, alone.cleaned().joints)
    kit = KIT.rest_joints()[None].repeat(30, 0)
    still = Motion(kit, 12.5, KIT, metadata={"count": {"act": "jump", "side": "", "times": 2}})
    assert "made" not in still.cleaned().metadata["count"]


def test_a_count_is_asked_only_where_the_length_is_predicted() -> None:
    generate = MotionPipeline.from_pretrained("fast", threads=1)
    prompts = ["jump twice", "kick three times with the left leg", "jump", "jump a few times"]
    found = [motion.metadata.get("count") for motion in generate.batch(prompts)]
    assert found[:2] == [
        {"act": "jump", "side": "", "times": 2},
        {"act": "kick", "side": "left", "times": 3},
    ]
    assert found[2:] == [None, None]
    timed = [*generate.batch(prompts, 2.0), generate.timeline(prompts[:2])]
    timed.append(generate.loop("jump twice", 1.6))
    assert not any("count" in motion.metadata for motion in timed)
