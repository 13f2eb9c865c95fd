"""Locomotion: gait by speed, direction in the body frame, turns by degrees, the path."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.measure.facts import Event, joined_moves
from latentmotion.measure.scene import describe, in_place, meters
from latentmotion.measure.whole_body import MOVING
from tests.support import acted


@pytest.mark.parametrize("speed", [0.4, 0.7, 1.0, 1.4, 1.8])
@pytest.mark.parametrize(
    ("way", "direction"),
    [(0, "forward"), (40, "forward"), (90, "left"), (-90, "right"), (-145, "backward")],
)
def test_a_walk_has_its_direction_and_speed(speed: float, way: float, direction: str) -> None:
    (move,) = describe(acted.walk(3, speed, way)).moves
    assert (move.kind, move.direction) == ("walk", direction)
    assert move.amount == pytest.approx(speed, rel=0.05)


@pytest.mark.parametrize(
    ("speed", "kind"), [(1.5, "walk"), (1.95, "jog"), (2.4, "jog"), (3.0, "run"), (4.5, "run")]
)
def test_a_gait_with_flight_is_a_jog_or_a_run_by_speed(speed: float, kind: str) -> None:
    motion = acted.run(4, speed) if speed > 1.5 else acted.walk(4, speed)
    assert {move.kind for move in describe(motion).moves} == {kind}


@pytest.mark.parametrize(("speed", "moves"), [(MOVING - 0.05, False), (MOVING + 0.08, True)])
def test_who_sways_slower_than_the_least_speed_stands(speed: float, moves: bool) -> None:
    found = describe(acted.Body(frames=80, ahead=speed).joints())
    assert bool(found.find("walk")) is moves
    assert (found.path.length > 0) is moves
    assert len(found.find("stand")) == (1 if moves else 2)  # the posture, and the move


@pytest.mark.parametrize("degrees", [30, 60, 90, 135, 180, 270, 360])
@pytest.mark.parametrize("sign", [1, -1])
def test_turns_on_the_spot_have_side_and_degrees(degrees: float, sign: int) -> None:
    found = describe(acted.turn_in_place(sign * degrees, 2 + degrees / 180))
    (turn,) = found.turns
    assert turn.side == ("left" if sign > 0 else "right")
    assert turn.direction == "place"
    assert turn.amount == pytest.approx(degrees, abs=5)
    assert found.path.turned == pytest.approx(sign * degrees, abs=1)


@pytest.mark.parametrize("degrees", [45, 90, 180])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("way", [0, 180])
def test_turns_on_the_way_are_walked(degrees: float, sign: int, way: float) -> None:
    found = describe(acted.walk(4, 1.0, way, sign * degrees))
    (turn,) = found.turns
    assert (turn.side, turn.direction) == ("left" if sign > 0 else "right", "walking")
    assert turn.amount == pytest.approx(degrees, abs=8)


@pytest.mark.parametrize(("degrees", "count"), [(12, 0), (20, 0), (35, 1)])
def test_the_smallest_turn(degrees: float, count: int) -> None:
    assert len(describe(acted.turn_in_place(degrees, 1)).turns) == count


@pytest.mark.parametrize(("pause", "count"), [(0.3, 1), (2.0, 2)])
def test_a_pause_divides_a_turn(pause: float, count: int) -> None:
    frames = round((2 + pause) * acted.FPS) + 20
    last = frames - 10
    heading = 90 * acted.ramp(frames, 10, 30) + 90 * acted.ramp(frames, last - 20, last)
    turns = describe(acted.Body(frames=frames, heading=heading).joints()).turns
    assert len(turns) == count
    assert sum(turn.amount for turn in turns) == pytest.approx(180, abs=12)


def test_turns_to_both_sides_are_told_apart() -> None:
    found = describe(acted.in_sequence(acted.turn_in_place(90), acted.turn_in_place(-120)))
    assert [turn.side for turn in found.turns] == ["left", "right"]
    assert found.path.turned == pytest.approx(-30, abs=2)


def test_hips_that_twist_over_planted_feet_do_not_turn() -> None:
    turned = acted.turn_in_place(40, 2)
    planted = turned.copy()
    planted[:, [7, 8, 10, 11]] = turned[:1, [7, 8, 10, 11]]
    assert not describe(planted).turns
    assert describe(turned).turns


def test_a_straight_path() -> None:
    path = describe(acted.walk(4, 1.0)).path
    assert path.forward == pytest.approx(4.0, abs=0.1)
    assert path.length == pytest.approx(path.ahead, abs=1e-6)
    assert path.left == pytest.approx(0, abs=0.01)
    assert path.turned == pytest.approx(0, abs=0.1)
    assert not path.closed


@pytest.mark.parametrize(
    ("way", "forward", "left"), [(90, 0, 3.2), (-90, 0, -3.2), (180, -3.2, 0), (45, 2.26, 2.26)]
)
def test_displacement_is_in_the_frame_of_the_first_heading(
    way: float, forward: float, left: float
) -> None:
    path = describe(acted.walk(4, 0.8, way)).path
    assert (path.forward, path.left) == pytest.approx((forward, left), abs=0.1)


def test_ahead_is_counted_with_the_heading_at_the_time() -> None:
    path = describe(acted.walk(8, 1.0, turn=360)).path
    assert path.closed
    assert path.ahead == pytest.approx(8, abs=0.4)
    assert np.hypot(path.forward, path.left) < 0.5


@pytest.mark.parametrize("turn", [180, 270, 360, -360])
def test_a_path_is_closed_where_it_ends_near_its_start(turn: float) -> None:
    assert describe(acted.walk(8, 1.0, turn=turn)).path.closed is (abs(turn) == 360)


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("walk and stop", ["walk", "stand"]),
        ("walk, then wave", ["walk", "stand"]),
        ("turn, then walk", ["stand", "walk"]),
        ("wave, then walk", ["stand", "walk"]),
    ],
)
def test_moves_follow_each_other_without_gaps(name: str, kinds: list[str]) -> None:
    found = acted.scene(name)
    assert [move.kind for move in found.moves if move.frames >= 10] == kinds


@pytest.mark.parametrize("name", acted.MOTIONS)
def test_moves_and_postures_fill_the_motion(name: str) -> None:
    found = acted.scene(name)
    for row in (found.moves, found.postures):
        assert [one.start for one in row[1:]] == [one.end for one in row[:-1]]
        assert (row[0].start, row[-1].end) == (0, found.frames)
    for event in (*found.events, *found.turns):
        assert 0 <= event.start < event.end <= found.frames
        assert event.count >= 1
    assert list(found.events) == sorted(found.events, key=lambda event: event.start)


@pytest.mark.parametrize(
    ("way", "direction"), [(0, "forward"), (180, "backward"), (90, "left"), (-90, "right")]
)
def test_meters_are_summed_by_direction(way: float, direction: str) -> None:
    distances = meters(describe(acted.walk(4, 0.8, way)))
    assert distances.pop(direction) == pytest.approx(3.2, abs=0.15)
    assert max(distances.values()) < 0.05


@pytest.mark.parametrize(("most", "stays"), [(0.3, False), (2.5, True)])
def test_staying_in_place_is_relative_to_a_distance(most: float, stays: bool) -> None:
    assert in_place(acted.scene("walk"), most) is stays


@pytest.mark.parametrize(("gap", "kind", "count"), [(2, "walk", 1), (12, "walk", 2), (2, "jog", 2)])
def test_like_moves_are_joined(gap: int, kind: str, count: int) -> None:
    one = Event("walk", 0, 20, direction="forward", amount=1.0)
    other = Event(kind, 20 + gap, 30 + gap, direction="forward", amount=2.5)
    joined = joined_moves([one, other], 10)
    assert len(joined) == count
    assert joined[-1].end == 30 + gap
    if count == 1:
        assert joined[0].amount == pytest.approx(1.5)  # weighted by their frames
