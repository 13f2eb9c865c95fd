"""Exact counts: what is asked, what is left as it is, and that what is made is smooth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.cleanup import CleanUp, CleanUpWarning, clean, clean_batch
from latentmotion.control.stream import generate_loop
from latentmotion.control.timeline import generate_timeline
from latentmotion.kinematics.plausibility import jitter
from latentmotion.kinematics.skeleton import KIT
from latentmotion.language.claims import NO_CORRECTIONS, Corrections, Count
from latentmotion.measure.repetitions import repetitions
from tests.support import acted

NO_COUNT = CleanUp(exact_count=False)


def asks(joints: np.ndarray, act: str, times: int, side: str = "") -> tuple[Motion, Corrections]:
    return Motion(joints.astype(np.float32)), Corrections(count=Count(act, side, times))


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
        (acted.clap(5), "clap", "", 5, 3),
    ],
)
def test_it_is_done_as_often_as_asked(
    joints: np.ndarray, act: str, side: str, made: int, times: int
) -> None:
    motion, corrections = asks(joints, act, times, side)
    exact, plain = (clean(motion, steps, corrections) for steps in (None, NO_COUNT))
    assert counted(plain, act, side) == made and plain.metadata == motion.metadata
    assert counted(exact, act, side) == times and exact.metadata["count"]["made"] == made
    assert (len(exact) > len(plain)) == (times > made)
    assert jitter(exact.joints, 20.0) < 1.5 * jitter(plain.joints, 20.0)


@pytest.mark.parametrize("times", [19, 99])
def test_as_often_as_fits_where_more_is_asked(times: int) -> None:
    motion, corrections = asks(acted.jump(2), "jump", times)
    with pytest.warns(CleanUpWarning, match=f"{times} times take too long, [0-9]+ fit"):
        exact = clean(motion, corrections=corrections)
    assert 5 <= counted(exact, "jump") < 19 and 8 < len(exact) / exact.fps < 10


@pytest.mark.parametrize(
    ("act", "times", "side"),
    [("jump", 2, ""), ("kick", 2, ""), ("juggle", 3, ""), ("jump", 0, "")],
)
def test_other_motions_are_left_as_they_are(act: str, times: int, side: str) -> None:
    motion, corrections = asks(acted.jump(2), act, times, side)
    exact = clean(motion, corrections=corrections)
    assert np.array_equal(exact.joints, clean(motion).joints)
    assert exact.metadata == motion.metadata


def test_what_metadata_say_is_not_obeyed() -> None:
    joints = acted.jump(2).astype(np.float32)
    saved = Motion(joints, metadata={"count": {"act": "jump", "side": "", "times": 3}})
    assert np.array_equal(saved.cleaned().joints, Motion(joints).cleaned().joints)
    assert saved.cleaned().metadata == saved.metadata


def test_an_act_of_the_other_side_is_left_as_it_is() -> None:
    kicks = acted.in_sequence(acted.kick("left", 1), acted.kick("right", 1))
    motion, corrections = asks(kicks, "kick", 2, "left")
    assert "count" not in clean(motion, corrections=corrections).metadata


def test_half_a_repetition_is_neither_counted_nor_repeated() -> None:
    part = acted.bump(30, 7.5, 15, 22.5)[:, None] * np.array([0.0, 0.33, 0.4])
    swing = acted.Body(frames=30, feet={"left": part}).joints()
    kicks = acted.in_sequence(acted.kick("left", 1), swing)
    found = repetitions(kicks, "kick")
    assert found and (len(found.full), len(found.weak)) == (1, 1)
    motion, corrections = asks(kicks, "kick", 3)
    exact = clean(motion, corrections=corrections)
    found = repetitions(exact.joints.astype(np.float64), "kick")
    assert found and (len(found.full), found.weak) == (3, ())


def test_half_a_repetition_beside_the_right_number_goes() -> None:
    part = acted.bump(30, 7.5, 15, 22.5)[:, None] * np.array([0.0, 0.33, 0.4])
    swing = acted.Body(frames=30, feet={"right": part}).joints()
    kicks = acted.in_sequence(acted.kick("left", 2), swing)
    motion, corrections = asks(kicks, "kick", 2)
    exact = clean(motion, corrections=corrections)
    found = repetitions(exact.joints.astype(np.float64), "kick")
    assert found and (len(found.full), found.weak) == (2, ()) and len(exact) < len(kicks)


def test_what_follows_the_repetitions_stays() -> None:
    follows = acted.in_sequence(acted.stand(1.5), acted.bow(1), acted.stand(1.0))
    motion, corrections = asks(acted.in_sequence(acted.clap(5), follows), "clap", 2)
    exact = clean(motion, corrections=corrections)
    assert counted(exact, "clap") == 2 and counted(exact, "bow") == 1


def test_a_path_goes_on_the_way_that_the_body_faces() -> None:
    motion, corrections = asks(acted.elsewhere(acted.jump(2, speed=1.0), 70.0), "jump", 3)
    plain, exact = clean(motion), clean(motion, corrections=corrections)
    one, other = (m.joints[-1, 0] - m.joints[0, 0] for m in (plain, exact))
    assert np.hypot(one[0], one[2]) + 0.3 < np.hypot(other[0], other[2])
    assert np.degrees(np.arctan2(other[0], other[2]) - np.arctan2(one[0], one[2])) % 360 < 15


@pytest.mark.parametrize("steps", [CleanUp(), CleanUp(in_place=True)])
def test_a_motion_beside_one_with_a_count_is_what_it_is_alone(steps: CleanUp) -> None:
    kicks = Motion(acted.kick("left", 2).astype(np.float32)), NO_CORRECTIONS
    pairs = [kicks, asks(acted.jump(2), "jump", 3)]
    motions, corrections = [one for one, _ in pairs], [one for _, one in pairs]
    together = clean_batch(motions, steps, corrections)
    for motion, correction, found in zip(motions, corrections, together, strict=True):
        assert np.array_equal(clean(motion, steps, correction).joints, found.joints)


def test_it_is_made_in_place_and_forgotten_in_parts() -> None:
    motion, corrections = asks(acted.jump(2, speed=1.0), "jump", 3)
    exact = clean(motion, corrections=corrections)
    again = clean(exact, corrections=corrections)
    assert len(again) == len(exact) and again.metadata == exact.metadata
    assert "count" not in exact.cut(0, 1).metadata and "count" not in exact.mirrored().metadata
    placed = clean(motion, CleanUp(in_place=True), corrections)
    assert len(placed) == len(exact)
    assert np.abs(placed.joints[:, 0, [0, 2]]).max() < 0.3 < np.ptp(exact.joints[:, 0, 2])


def test_together_as_alone_and_other_skeletons() -> None:
    pairs = [asks(acted.jump(n), "jump", 2) for n in (1, 2, 3)]
    motions, corrections = [one for one, _ in pairs], [one for _, one in pairs]
    together = clean_batch(motions, corrections=corrections)
    for motion, correction, found in zip(motions, corrections, together, strict=True):
        assert np.array_equal(clean(motion, corrections=correction).joints, found.joints)
    kit = Motion(KIT.rest_joints()[None].repeat(30, 0), 12.5, KIT)
    assert "count" not in clean(kit, corrections=corrections[0]).metadata


def test_a_count_is_asked_only_where_the_length_is_predicted() -> None:
    generate = MotionPipeline.from_pretrained("fast", threads=1)
    prompts = ["jump twice", "kick three times with the left leg", "jump", "jump a few times"]
    found = [motion.metadata.get("count") for motion in generate.batch(prompts)]
    assert found[:2] == [
        {"act": "jump", "side": "", "times": 2},
        {"act": "kick", "side": "left", "times": 3},
    ]
    assert found[2:] == [None, None]
    timed = [*generate.batch(prompts, 2.0), generate_timeline(generate, prompts[:2])]
    timed.append(generate_loop(generate, "jump twice", 1.6))
    assert not any("count" in motion.metadata for motion in timed)


def test_a_recorded_motion_loses_its_recording_where_frames_are_left_out(tmp_path: Path) -> None:
    bows, corrections = asks(acted.bow(3), "bow", 1)
    bows.save(tmp_path / "bows.bvh")
    recorded = Motion.load(tmp_path / "bows.bvh").resampled(20.0)
    assert recorded.recorded is not None
    exact = recorded.cleaned(corrections=corrections)
    assert len(exact) < len(recorded) and exact.recorded is None
    assert recorded.cleaned().recorded is not None
