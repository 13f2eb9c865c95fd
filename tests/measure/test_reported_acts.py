"""Which acts of a description are reported: repetitions counted, parts of other acts left out."""

from __future__ import annotations

import pytest

from latentmotion.measure.facts import Description, Event, FloorPath
from latentmotion.measure.reported_acts import acts_of
from tests.support import acted

STILL = FloorPath(0, 0, 0, 0, 0, 0, False)
FAR = FloorPath(4, 4, 0, 4, 0, 0, False)


def described(
    *events: Event,
    frames: int = 200,
    path: FloorPath = STILL,
    moves: tuple[Event, ...] = (),
    turns: tuple[Event, ...] = (),
    postures: tuple[Event, ...] = (),
    activity: float = 0.3,
) -> Description:
    """A motion with some events, standing where nothing else is given."""
    moves = moves or (Event("stand", 0, frames),)
    postures = postures or (Event("stand", 0, frames),)
    return Description(
        frames, path, moves, turns, postures, tuple(events), 0, (0, 0), activity=activity
    )


def told(description: Description) -> list[tuple[str, str, int]]:
    return [(act.kind, act.event.side, act.event.count) for act in acts_of(description)]


def kick(start: int, side: str = "left", kind: str = "kick") -> Event:
    return Event(kind, start, start + 10, side, "forward", 0.6)


@pytest.mark.parametrize(
    ("events", "acts"),
    [
        ([kick(0), kick(30), kick(60)], [("kick", "left", 3)]),
        ([kick(0), kick(60)], [("kick", "left", 1), ("kick", "left", 1)]),
        ([kick(0), kick(30, "right")], [("kick", "left", 1), ("kick", "right", 1)]),
        ([kick(0), kick(20, "right"), kick(40)], [("kick", "both", 3)]),
        (
            [kick(0, kind="jump"), kick(30, kind="hop"), kick(50, kind="jump")],
            [("jump", "left", 1), ("hop", "left", 1), ("jump", "left", 1)],
        ),
        (
            [kick(0, kind="punch"), kick(15, "right", "raise"), kick(30, kind="punch")],
            [("punch", "left", 2), ("raise", "right", 1)],
        ),
    ],
    ids=["three", "far apart", "two sides", "alternating", "another between", "another arm"],
)
def test_repetitions_are_one_act(events: list[Event], acts: list[tuple[str, str, int]]) -> None:
    assert told(described(*events)) == acts


@pytest.mark.parametrize(
    ("part", "whole"),
    [
        (Event("raise", 0, 40, "left", "up", 0.4), Event("wave", 5, 35, "left", count=3)),
        (Event("raise", 0, 40, "left", "up", 0.4), Event("clap", 5, 35, "both", count=3)),
        (Event("raise", 0, 20, "both", "up", 0.4), Event("jump", 25, 35, "both", "place", 0.3)),
        (Event("squat", 0, 20, amount=0.4), Event("jump", 22, 35, "both", "place", 0.3)),
        (Event("knee", 0, 10, "left", "up", 0.4), kick(8)),
        (Event("bow", 0, 10, direction="forward", amount=50), Event("sit_down", 8, 30)),
        (Event("hop", 0, 10, "right", "place", 0.1), kick(5)),
        (Event("knee", 0, 10, "left", "up", 0.4), Event("climb", 5, 60, direction="up")),
    ],
)
def test_parts_of_other_acts_are_left_out(part: Event, whole: Event) -> None:
    assert [act.kind for act in acts_of(described(part, whole))] == [whole.kind]
    assert [act.kind for act in acts_of(described(part))] == [part.kind]


def test_the_other_hand_is_an_act_of_its_own() -> None:
    raised = Event("raise", 0, 40, "right", "up", 0.4)
    waved = Event("wave", 5, 35, "left", count=3)
    assert {one[:2] for one in told(described(raised, waved))} == {
        ("raise", "right"),
        ("wave", "left"),
    }


@pytest.mark.parametrize(("frames", "amount", "shown"), [(4, 0.5, False), (20, 0.5, True)])
def test_a_hand_that_is_up_for_a_moment_is_left_out(
    frames: int, amount: float, shown: bool
) -> None:
    found = described(Event("raise", 0, frames, "left", "up", amount))
    assert ("raise" in {act.kind for act in acts_of(found)}) is shown


@pytest.mark.parametrize(("meters", "shown"), [(0.3, False), (1.5, True)])
def test_small_shifts_are_left_out(meters: float, shown: bool) -> None:
    walk = Event("walk", 0, 40, direction="forward", amount=meters / 2)
    found = described(moves=(walk, Event("stand", 40, 200)), path=FAR)
    assert ("walk" in {act.kind for act in acts_of(found)}) is shown


def test_a_move_that_is_part_of_a_jump_is_left_out() -> None:
    walk = Event("walk", 40, 60, direction="forward", amount=0.8)
    jump = Event("jump", 42, 58, "both", "forward", 0.3)
    moves = (Event("stand", 0, 40), walk, Event("stand", 60, 200))
    assert [act.kind for act in acts_of(described(jump, moves=moves, path=FAR))] == ["jump"]
    assert "walk" in [act.kind for act in acts_of(described(moves=moves, path=FAR))]


WALK = Event("walk", 0, 200, direction="forward", amount=1.0)


def test_a_turn_during_the_whole_walk_is_a_curve() -> None:
    turn = Event("turn", 20, 190, "left", "walking", 120)
    (act,) = acts_of(described(moves=(WALK,), turns=(turn,), path=FAR))
    assert (act.kind, act.event.side, act.event.start, act.event.end) == ("turn", "left", 0, 200)
    assert act.gait == WALK


def test_a_short_turn_divides_a_walk() -> None:
    turn = Event("turn", 90, 110, "right", "walking", 90)
    acts = acts_of(described(moves=(WALK,), turns=(turn,), path=FAR))
    assert [(act.kind, act.on) for act in acts] == [
        ("walk", False),
        ("turn", False),
        ("walk", True),
    ]
    assert [act.event.end for act in acts] == [90, 110, 200]


@pytest.mark.parametrize(
    ("degrees", "direction", "shown"),
    [(40, "place", False), (60, "place", True), (40, "walking", True), (28, "walking", False)],
)
def test_small_turns_are_left_out(degrees: float, direction: str, shown: bool) -> None:
    turn = Event("turn", 90, 110, "right", direction, degrees)
    found = described(moves=(WALK,), turns=(turn,), path=FAR)
    assert ("turn" in {act.kind for act in acts_of(found)}) is shown


def test_a_walk_in_a_crouch_says_so() -> None:
    crouch = (Event("crouch", 0, 180), Event("stand", 180, 200))
    acts = acts_of(described(moves=(WALK,), postures=crouch, path=FAR))
    assert [(act.kind, act.posture) for act in acts] == [("walk", "crouch")]


@pytest.mark.parametrize(("stands", "stops"), [(8, False), (40, True)])
def test_who_walks_and_then_stands_stops(stands: int, stops: bool) -> None:
    walk = Event("walk", 0, 200 - stands, direction="forward", amount=1.0)
    moves = (walk, Event("stand", 200 - stands, 200))
    acts = acts_of(described(moves=moves, path=FAR))
    assert [act.kind for act in acts] == ["walk", *["stop"] * stops]


@pytest.mark.parametrize(("activity", "kind"), [(0.02, "still"), (0.3, "stand"), (0.8, "gesture")])
def test_who_does_nothing_else_stands(activity: float, kind: str) -> None:
    assert [act.kind for act in acts_of(described(activity=activity))] == [kind]


def test_a_held_posture_is_reported_unless_its_beginning_is() -> None:
    sits = (Event("sit", 0, 200),)
    assert [act.kind for act in acts_of(described(postures=sits))] == ["stay_sit"]
    falls = (Event("stand", 0, 50), Event("sit", 50, 200))
    change = Event("sit_down", 44, 56)
    assert [act.kind for act in acts_of(described(change, postures=falls))] == ["sit_down"]


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("walk, then wave", ["walk", "wave"]),
        ("wave, then walk", ["wave", "walk"]),
        ("walk and stop", ["walk", "stop"]),
        ("walk, then sit down", ["walk", "sit_down"]),
        ("turn, then walk", ["turn", "walk"]),
        ("walk a curve", ["turn"]),
        ("kick to the side", ["kick"]),
        ("punch", ["punch"]),
        ("squat", ["squat"]),
        ("stand", ["still"]),
        ("march", ["walk"]),
        ("sit down", ["sit_down"]),
        ("crouch", ["stay_crouch"]),
        ("jump forward", ["jump"]),
        ("circle an arm", ["arm_circle"]),
    ],
)
def test_motions_are_reported_in_their_order(name: str, kinds: list[str]) -> None:
    assert [act.kind for act in acts_of(acted.scene(name))] == kinds
