"""Exact turns: what is asked, and what is left as it is."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.cleanup import CleanUp, clean, clean_batch
from latentmotion.kinematics.skeleton import KIT
from latentmotion.language.claims import Corrections, Turn
from latentmotion.measure.scene import describe
from tests.support import acted

NO_TURN = CleanUp(exact_turn=False)


def asks(degrees: float, side: str = "") -> Corrections:
    return Corrections(Turn(degrees, side))


def turned(motion: Motion) -> float:
    return describe(motion.joints.astype(np.float64)).path.turned


@pytest.mark.parametrize(
    ("made", "degrees", "side"),
    [
        (60, 90, "left"),
        (-150, 90, "right"),
        (130, 180, ""),
        (-250, 360, "right"),
        (70, 45, "left"),
        (-110, 45, "right"),
        (128, 45, ""),
    ],
)
def test_a_turn_of_the_right_sense_becomes_exact(made: float, degrees: float, side: str) -> None:
    motion = Motion(acted.turn_in_place(made))
    exact, plain = (clean(motion, steps, asks(degrees, side)) for steps in (None, NO_TURN))
    assert turned(exact) == pytest.approx(np.sign(made) * degrees, abs=2.5)
    assert exact.metadata["turn"]["made"] == pytest.approx(made, abs=2)
    assert turned(plain) == pytest.approx(made, abs=2.5) and plain.metadata == motion.metadata


@pytest.mark.parametrize(
    ("degrees", "side"),
    [(90, "right"), (25, "left"), (200, "left"), (90.4, "left"), (1, ""), (float("nan"), ""),
     (1e9, "")],
)  # fmt: skip
def test_other_turns_are_left_as_they_are(degrees: float, side: str) -> None:
    motion = Motion(acted.turn_in_place(90.0))
    exact = clean(motion, corrections=asks(degrees, side))
    assert np.array_equal(exact.joints, clean(motion).joints)
    assert exact.metadata == motion.metadata


def test_what_metadata_say_is_not_obeyed() -> None:
    joints = acted.turn_in_place(60.0)
    saved = Motion(joints, metadata={"turn": {"degrees": 90.0, "side": "left"}})
    assert np.array_equal(saved.cleaned().joints, Motion(joints).cleaned().joints)
    assert saved.cleaned().metadata == saved.metadata


def test_a_path_bends_with_the_turn() -> None:
    steps = CleanUp(smooth=False, bones=False, floor=False, feet=False)
    walk = acted.walk(4.0, 1.2, turn=120.0)
    exact = clean(Motion(walk), steps, asks(180, "left"))
    lengths = [np.linalg.norm(np.diff(j[:, 0], axis=0), axis=1) for j in (walk, exact.joints)]
    assert np.allclose(*lengths, atol=1e-5)
    assert np.allclose(exact.joints[0], walk[0], atol=1e-6)
    ahead = exact.joints[-1, 0] - exact.joints[-2, 0]
    before = walk[-1, 0] - walk[-2, 0]
    angle = np.degrees(np.arctan2(ahead[0], ahead[2]) - np.arctan2(before[0], before[2]))
    assert angle % 360 == pytest.approx(60, abs=3)


def test_it_stays_and_is_forgotten_in_parts() -> None:
    exact = clean(Motion(acted.turn_in_place(60.0)), corrections=asks(90, "left"))
    again = clean(exact)
    assert turned(again) == pytest.approx(90, abs=2) and again.metadata == exact.metadata
    assert "turn" not in exact.cut(0, 1).metadata and "turn" not in exact.mirrored().metadata


def test_together_as_alone_and_other_skeletons() -> None:
    motions = [Motion(acted.turn_in_place(n)) for n in (60.0, 120.0, 20.0)]
    corrections = asks(90, "left")
    together = clean_batch(motions, corrections=[corrections] * 3)
    for motion, found in zip(motions, together, strict=True):
        assert np.array_equal(clean(motion, corrections=corrections).joints, found.joints)
    still = Motion(KIT.rest_joints()[None].repeat(9, 0), 12.5, KIT)
    assert "turn" not in clean(still, corrections=corrections).metadata


@pytest.mark.filterwarnings("ignore::latentmotion.retrieval.doubts.DoubtWarning")
def test_a_sentence_tells_the_turn() -> None:
    generate = MotionPipeline.from_pretrained("fast", threads=1)
    prompts = ["do a one-eighty", "turn right by 90 degrees", "turn left", "walk in a circle"]
    found = [motion.metadata.get("turn") for motion in generate.batch(prompts, 1.0)]
    assert found == [{"degrees": 180, "side": ""}, {"degrees": 90, "side": "right"}, None, None]


def test_a_motion_that_turns_back_is_left_as_it_is() -> None:
    there, back = acted.turn_in_place(90.0), acted.turn_in_place(-60.0)
    motion = Motion(np.concatenate([there, turned_about(back, 90.0)[1:]]))
    assert turned(motion) == pytest.approx(30, abs=3)
    assert clean(motion, corrections=asks(45, "left")).metadata == motion.metadata


def turned_about(joints: np.ndarray, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return joints @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
