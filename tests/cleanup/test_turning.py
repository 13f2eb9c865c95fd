"""Exact turns: what is asked, and what is left as it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latentmotion import Motion, MotionPipeline
from latentmotion.cleanup import CleanUp
from latentmotion.cleanup.turning import Turn
from latentmotion.describe.reading import describe
from latentmotion.kinematics.skeleton import KIT
from latentmotion.motion import cleaned
from tests.support import acted


def asks(joints: np.ndarray, degrees: object, side: object = "") -> Motion:
    return Motion(joints, metadata={"turn": {"degrees": degrees, "side": side}})


def turned(motion: Motion) -> float:
    return describe(motion.joints.astype(np.float64)).path.turned


@pytest.mark.parametrize(
    ("made", "degrees", "side"),
    [(60, 90, "left"), (-150, 90, "right"), (130, 180, ""), (-250, 360, "right"), (70, 45, "left")],
)
def test_a_turn_of_the_right_sense_becomes_exact(made: float, degrees: float, side: str) -> None:
    motion = asks(acted.turn_in_place(made), degrees, side)
    exact = motion.cleaned()
    assert turned(exact) == pytest.approx(np.sign(made) * degrees, abs=2.5)
    assert exact.metadata["turn"]["made"] == pytest.approx(made, abs=2)
    plain = motion.cleaned(CleanUp(exact_turn=False))
    assert turned(plain) == pytest.approx(made, abs=2.5) and plain.metadata == motion.metadata


@pytest.mark.parametrize(
    ("degrees", "side"),
    [(90, "right"), (30, "left"), (200, "left"), (90.4, "left"), (90, "up"), (True, ""),
     (float("nan"), ""), ("90", ""), (1e9, ""), (None, "")],
)  # fmt: skip
def test_other_turns_are_left_as_they_are(degrees: object, side: object) -> None:
    joints = acted.turn_in_place(90.0)
    motion = asks(joints, degrees, side)
    assert np.array_equal(motion.cleaned().joints, Motion(joints).cleaned().joints)
    assert motion.cleaned().metadata == motion.metadata


@pytest.mark.parametrize("turn", [7, {}, [90], {"degrees": {}}, {"degrees": 90, "side": 1}])
def test_odd_metadata_ask_for_nothing(turn: Any) -> None:
    assert Turn.of({"turn": turn}) is None


def test_a_path_bends_with_the_turn() -> None:
    steps = CleanUp(smooth=False, bones=False, floor=False, feet=False)
    walk = acted.walk(4.0, 1.2, turn=120.0)
    exact = asks(walk, 180, "left").cleaned(steps)
    lengths = [np.linalg.norm(np.diff(j[:, 0], axis=0), axis=1) for j in (walk, exact.joints)]
    assert np.allclose(*lengths, atol=1e-5)
    assert np.allclose(exact.joints[0], walk[0], atol=1e-6)
    ahead = exact.joints[-1, 0] - exact.joints[-2, 0]
    before = walk[-1, 0] - walk[-2, 0]
    angle = np.degrees(np.arctan2(ahead[0], ahead[2]) - np.arctan2(before[0], before[2]))
    assert angle % 360 == pytest.approx(60, abs=3)


def test_it_is_made_once_and_forgotten_in_parts() -> None:
    motion = asks(acted.turn_in_place(60.0), 90, "left")
    exact = motion.cleaned()
    again = exact.cleaned()
    assert turned(again) == pytest.approx(90, abs=2) and again.metadata == exact.metadata
    assert "turn" not in motion.cut(0, 1).metadata and "turn" not in motion.mirrored().metadata


def test_together_as_alone_and_other_skeletons() -> None:
    motions = [asks(acted.turn_in_place(n), 90, "left") for n in (60.0, 120.0, 20.0)]
    for one, alone in zip(cleaned(motions), motions, strict=True):
        assert np.array_equal(one.joints, alone.cleaned().joints)
    kit = KIT.rest_joints()[None].repeat(9, 0)
    still = Motion(kit, 12.5, KIT, metadata={"turn": {"degrees": 90.0, "side": ""}})
    assert "made" not in still.cleaned().metadata["turn"]


@pytest.mark.filterwarnings("ignore::latentmotion.retrieval.doubts.DoubtWarning")
def test_a_sentence_tells_the_turn() -> None:
    generate = MotionPipeline.from_pretrained("fast", threads=1)
    prompts = ["do a one-eighty", "turn right by 90 degrees", "turn left", "walk in a circle"]
    found = [motion.metadata.get("turn") for motion in generate.batch(prompts, 1.0)]
    assert found == [{"degrees": 180, "side": ""}, {"degrees": 90, "side": "right"}, None, None]
