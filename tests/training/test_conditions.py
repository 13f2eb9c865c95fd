"""Conditions at their bounds: one motion each on both sides of a number."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.data.instructions import parse
from latentmotion.measure.scene import describe
from latentmotion.training.checking import fulfills
from tests.support import acted


def holds(motion: np.ndarray, text: str) -> bool:
    return fulfills(describe(motion), parse(text))


WALK, CURVE = acted.walk(4, 1.0), acted.walk(4, 1.0, turn=90)
SIDEWAYS = acted.walk(4, 0.8, 90)
FASTER = acted.Body(frames=90, ahead=np.linspace(0.5, 1.5, 90)).joints()
GOING_STILL = acted.in_sequence(acted.walk(2), acted.stand(4))


@pytest.mark.parametrize(
    ("motion", "inside", "outside"),
    [
        (WALK, "travel(3.8)", "travel(4.1)"),
        (WALK, "move(forward, 3.8)", "move(forward, 4.1)"),
        (SIDEWAYS, "move(left, 3)", "move(left, 3.5)"),
        (SIDEWAYS, "move(sideways, 3)", "move(sideways, 3.5)"),
        (WALK, "speed(0.9, 1.1)", "speed(1.05, 2)"),
        (WALK, "speed(0.5, 1.0)", "speed(0.5, 0.9)"),
        (WALK, "in_place(2.05)", "in_place(1.9)"),
        (CURVE, "turn(left, 85, 95)", "turn(left, 95, 120)"),
        (CURVE, "turn(either, 85, 95)", "turn(either, 0, 85)"),
        (CURVE, "facing(92)", "facing(85)"),
        (acted.walk(4, 1.0, turn=30), "straight(32)", "straight(25)"),
        (FASTER, "faster(1.8)", "faster(2.2)"),
        (FASTER[::-1], "slower(1.8)", "slower(2.2)"),
        (acted.jump(rise=0.3), "height(0.25)", "height(0.35)"),
        (GOING_STILL, "still(0.55)", "still(0.75)"),
        (acted.march(4), "lift_feet(7, 7)", "lift_feet(8, 99)"),
        (acted.steps(4), "step(4, 4)", "step(5, 9)"),
    ],
)
def test_bounds(motion: np.ndarray, inside: str, outside: str) -> None:
    assert holds(motion, inside)
    assert not holds(motion, outside)


@pytest.mark.parametrize(
    ("side", "turn", "held"),
    [("left", 400, True), ("right", -400, True), ("left", -400, False), ("either", -400, True)],
)
def test_full_turns_are_added_up(side: str, turn: float, held: bool) -> None:
    assert holds(acted.walk(8, 1.0, turn=turn), f"turn({side}, 380, 420)") is held


def test_a_turn_there_and_back_is_none_in_all() -> None:
    motion = acted.in_sequence(acted.turn_in_place(90), acted.turn_in_place(-90))
    assert holds(motion, "facing(10)")
    assert not holds(motion, "turn(either, 30, 400)")
    assert holds(motion, "turn(left, 60, 120) > turn(right, 60, 120)")


def test_the_farthest_direction_counts() -> None:
    motion = acted.in_sequence(acted.walk(4, 0.8), acted.walk(2, 0.8, 180))
    assert holds(motion, "move(forward, 1)")
    assert not holds(motion, "move(backward, 1)")


def test_the_speed_is_that_of_moving_frames() -> None:
    assert holds(acted.in_sequence(acted.stand(4), acted.walk(3)), "speed(0.8, 1.1)")
    assert not holds(acted.stand(), "speed(0, 9)")
    assert not holds(acted.march(4), "speed(0, 9)")


@pytest.mark.parametrize(("degrees", "held"), [(10, False), (25, True)])
def test_a_path_weaves_by_degrees(degrees: float, held: bool) -> None:
    heading = degrees * np.sin(1.8 * np.arange(140) / acted.FPS)
    motion = acted.Body(frames=140, ahead=1.0, heading=heading).joints()
    assert holds(motion, "weave(30)") is held


@pytest.mark.parametrize("name", ["stand", "turn left", "walk", "walk a circle"])
def test_a_path_without_bends_does_not_weave(name: str) -> None:
    assert not fulfills(acted.scene(name), parse("weave(20)"))


@pytest.mark.parametrize(
    ("body", "stooped", "upright"),
    [
        (acted.Body(frames=40), False, True),
        (acted.Body(frames=40, height=0.8), True, True),
        (acted.Body(frames=40, lean=30.0), True, False),
        (acted.Body(frames=40, height=0.5), True, False),
        (acted.Body(frames=40, lean=15.0), False, True),
    ],
    ids=["upright", "low", "leaning", "crouched", "leaning a little"],
)
def test_stooped_and_upright(body: acted.Body, stooped: bool, upright: bool) -> None:
    assert holds(body.joints(), "stooped") is stooped
    assert holds(body.joints(), "upright") is upright
