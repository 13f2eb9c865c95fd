"""Acts of the arms: raised hands, waves, punches, claps, arm circles, and poses of the hands."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.measure.facts import LEFT, RIGHT, SIDES
from latentmotion.measure.scene import describe
from latentmotion.measure.signals import JOINT
from tests.support import acted

OTHER = {LEFT: RIGHT, RIGHT: LEFT}
ARMS = {"raise", "wave", "punch", "clap", "arm_circle"}


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("side", [*SIDES, "both"])
def test_raised_hands_are_counted_by_side(side: str, count: int) -> None:
    found = describe(acted.raise_hand(side, count))
    raises = found.find("raise")
    assert [(one.side, one.direction) for one in raises] == [(side, "up")] * count
    assert {event.kind for event in found.events} == {"raise"}


@pytest.mark.parametrize(
    ("away", "direction"),
    [
        ((0.05, 0.5, 0.05), "up"),
        ((0.3, 0.35, 0.0), "up"),
        ((0.48, 0.15, 0.0), "side"),
        ((0.0, 0.15, 0.48), "forward"),
    ],
)
def test_a_raise_goes_where_the_hand_is_highest(
    away: tuple[float, float, float], direction: str
) -> None:
    (one,) = describe(acted.raise_hand(RIGHT, 1, away)).find("raise")
    assert one.direction == direction
    assert one.amount == pytest.approx(away[1], abs=0.02)


@pytest.mark.parametrize(("height", "found"), [(0.04, False), (0.12, True)])
def test_a_hand_is_raised_above_its_shoulder(height: float, found: bool) -> None:
    assert bool(describe(acted.raise_hand(LEFT, 1, (0.0, height, 0.48))).find("raise")) is found


@pytest.mark.parametrize("high", SIDES)
def test_both_hands_are_raised_as_the_lower_one(high: str) -> None:
    part = acted.repeated(1, 2.0, lambda n: acted.bump(n, 0.1 * n, 0.5 * n, 0.9 * n))
    hands: dict[str, acted.Points] = {
        high: acted.swung((0.05, -0.5, 0.06), (0.05, 0.5, 0.05), part),
        OTHER[high]: acted.swung((0.05, -0.5, 0.06), (0.0, 0.15, 0.48), part),
    }
    (one,) = describe(acted.Body(frames=len(part), hands=hands).joints()).find("raise")
    assert (one.side, one.direction) == ("both", "forward")
    assert one.amount == pytest.approx(0.15, abs=0.02)


def test_hands_raised_in_turn_are_two_raises() -> None:
    found = describe(acted.in_sequence(acted.raise_hand(RIGHT), acted.raise_hand(LEFT)))
    assert [one.side for one in found.find("raise")] == [RIGHT, LEFT]


@pytest.mark.parametrize("side", [*SIDES, "both"])
@pytest.mark.parametrize("swings", [3, 6])
def test_waves_have_side_and_swings(side: str, swings: int) -> None:
    (wave,) = describe(acted.wave(side, swings)).find("wave")
    assert wave.side == side
    assert abs(wave.count - swings) <= 1


@pytest.mark.parametrize(("width", "found"), [(0.04, False), (0.3, True)])
def test_a_hand_that_is_only_held_up_does_not_wave(width: float, found: bool) -> None:
    described = describe(acted.wave(LEFT, 4, width))
    assert {one.side for one in described.find("raise")} == {LEFT}
    assert bool(described.find("wave")) is found


def test_a_hand_that_swings_while_the_body_walks_does_not_wave() -> None:
    waving = acted.wave(LEFT, 6)
    glide = np.arange(len(waving))[:, None, None] * np.array([0, 0, 1.0]) / acted.FPS
    assert not describe(waving + glide).find("wave")


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("count", [1, 2, 4])
def test_punches_are_counted(side: str, count: int) -> None:
    found = describe(acted.punch(side, count))
    punches = found.find("punch")
    assert sum(one.count for one in punches) == count
    assert {(one.side, one.direction) for one in punches} == {(side, "forward")}
    assert {event.kind for event in found.events} == {"punch"}


@pytest.mark.parametrize(("seconds", "found"), [(1.0, True), (2.5, False)])
def test_a_slow_reach_is_no_punch(seconds: float, found: bool) -> None:
    assert bool(describe(acted.punch(LEFT, 1, seconds)).find("punch")) is found


def test_a_push_with_both_hands_is_no_punch() -> None:
    part = acted.repeated(2, 1.0, lambda n: acted.bump(n, 0.3 * n, 0.5 * n, 0.8 * n))
    hand = acted.between((-0.05, -0.05, 0.2), (-0.05, 0, 0.5), part)
    body = acted.Body(frames=len(part), hands=dict.fromkeys(SIDES, hand))
    assert not describe(body.joints()).find("punch")


@pytest.mark.parametrize("count", [2, 3, 6])
def test_claps_are_counted(count: int) -> None:
    (clap,) = describe(acted.clap(count)).find("clap")
    assert (clap.side, clap.count) == ("both", count)


@pytest.mark.parametrize(
    ("count", "high"), [(1, -0.1), (4, -0.45)], ids=["a single one", "below the belly"]
)
def test_what_is_no_applause(count: int, high: float) -> None:
    assert not describe(acted.clap(count, high=high)).find("clap")


@pytest.mark.parametrize("direction", ["forward", "backward"])
@pytest.mark.parametrize("side", [*SIDES, "both"])
@pytest.mark.parametrize("count", [1, 3])
def test_arm_circles_have_side_direction_and_rounds(side: str, direction: str, count: int) -> None:
    (circle,) = describe(acted.arm_circle(side, count, direction)).find("arm_circle")
    assert (circle.side, circle.direction, circle.count) == (side, direction, count)


def test_an_arm_that_hangs_does_not_circle_yet() -> None:
    rest, circles = acted.stand(3), acted.arm_circle(RIGHT, 2)
    (circle,) = describe(acted.in_sequence(rest, circles, rest)).find("arm_circle")
    assert len(rest) <= circle.start < circle.end <= len(rest) + len(circles) + 12
    assert circle.count == 2


def test_arms_that_circle_against_each_other_have_no_direction() -> None:
    joints = acted.arm_circle(LEFT, 2, "forward")
    backward = acted.arm_circle(RIGHT, 2, "backward")
    for name in ("right_elbow", "right_wrist"):
        joints[:, JOINT[name]] = backward[:, JOINT[name]]
    (circle,) = describe(joints).find("arm_circle")
    assert (circle.side, circle.direction, circle.count) == ("both", "", 2)


@pytest.mark.parametrize(
    ("away", "sides", "kind", "side"),
    [
        ((0.5, 0.0, 0.0), SIDES, "arms_out", "both"),
        ((-0.05, 0.1, 0.1), (LEFT,), "touch_head", LEFT),
        ((-0.05, 0.1, 0.1), (RIGHT,), "touch_head", RIGHT),
        ((0.08, -0.4, 0.02), SIDES, "hands_on_hips", "both"),
    ],
)
def test_poses_of_the_hands(
    away: tuple[float, float, float], sides: tuple[str, ...], kind: str, side: str
) -> None:
    (pose,) = describe(acted.hands(3, away, sides)).all_of(kind)
    assert pose.side == side
    assert 20 <= pose.frames <= 50


@pytest.mark.parametrize("kind", ["arms_out", "hands_on_hips"])
def test_one_arm_makes_no_pose_of_both(kind: str) -> None:
    away = {"arms_out": (0.5, 0.0, 0.0), "hands_on_hips": (0.08, -0.4, 0.02)}[kind]
    assert not describe(acted.hands(3, away, (LEFT,))).all_of(kind)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_jumping_jacks_are_counted(count: int) -> None:
    assert len(describe(acted.jack(count)).all_of("jack")) == count


def test_arms_without_legs_make_no_jumping_jack() -> None:
    assert not describe(acted.raise_hand("both", 3, (0.3, 0.4, 0.1))).all_of("jack")


@pytest.mark.parametrize("name", ["stand", "walk", "run", "kick", "squat", "jump", "turn left"])
def test_hanging_arms_do_nothing(name: str) -> None:
    assert not [event for event in acted.scene(name).events if event.kind in ARMS]


@pytest.mark.parametrize(("degrees", "twist"), [(40.0, (40, 0)), (-30.0, (0, 30)), (0.0, (0, 0))])
def test_the_trunk_twists_to_its_side(degrees: float, twist: tuple[float, float]) -> None:
    body = acted.Body(frames=60, twist=degrees * acted.bump(60, 5, 30, 55))
    found = describe(body.joints())
    assert found.twist == pytest.approx(twist, abs=3)
    assert not found.turns
