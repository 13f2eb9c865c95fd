"""Acts of the legs: kicks, raised knees, jumps, hops, balance, steps, treading, stairs."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from latentmotion.measure.facts import LEFT, RIGHT, SIDES, Description
from latentmotion.measure.scene import describe
from tests.support import acted

OTHER = {LEFT: RIGHT, RIGHT: LEFT}


def happens_times(count: int, kind: str, found: Description) -> None:
    events = found.find(kind)
    assert len(events) == count
    assert all(a.end <= b.start for a, b in pairwise(events))


@pytest.mark.parametrize("count", [1, 2, 4])
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(
    ("kind", "make"), [("kick", acted.kick), ("knee", acted.knee_up), ("hop", acted.hop)]
)
def test_repetitions_of_one_leg_are_counted(
    kind: str, make: Callable[..., np.ndarray], side: str, count: int
) -> None:
    found = describe(make(side, count))
    happens_times(count, kind, found)
    assert [(event.side, event.count) for event in found.find(kind)] == [(side, 1)] * count
    others = {"kick", "knee", "hop", "jump"} - {kind}
    assert not [event for event in found.events if event.kind in others]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("direction", ["forward", "side"])
def test_a_kick_goes_where_the_foot_goes(side: str, direction: str) -> None:
    (kick,) = describe(acted.kick(side, 1, direction)).find("kick")
    assert (kick.side, kick.direction) == (side, direction)
    assert kick.amount == pytest.approx(0.6, abs=0.03)
    assert kick.start < 25 < kick.end  # the foot is highest in the middle


@pytest.mark.parametrize("side", SIDES)
def test_a_leg_that_is_lifted_slowly_does_not_kick(side: str) -> None:
    found = describe(acted.kick(side, seconds=6))
    assert not found.find("kick")
    assert side in {knee.side for knee in found.find("knee")}
    assert OTHER[side] in {one.side for one in found.find("balance")}


@pytest.mark.parametrize(("reach", "found"), [(0.25, False), (0.6, True)])
def test_a_low_kick_swings_far_and_fast(reach: float, found: bool) -> None:
    """As at a ball: the foot stays below the knee of the other leg."""
    frames = 30
    back = acted.between((0, 0, 0), (0, 0.15, -0.35), acted.bump(frames, 5, 12, 17))
    ahead = acted.between((0, 0, 0), (0, 0.15, reach), acted.bump(frames, 12, 17, 26))
    described = describe(acted.Body(frames=frames, feet={RIGHT: back + ahead}).joints())
    assert [(one.side, one.direction) for one in described.find("kick")] == (
        [(RIGHT, "forward")] if found else []
    )


@pytest.mark.parametrize(("height", "found"), [(0.15, False), (0.45, True)])
def test_a_knee_counts_from_the_hip_up(height: float, found: bool) -> None:
    assert bool(describe(acted.knee_up(LEFT, 1, height)).find("knee")) is found


@pytest.mark.parametrize("count", [1, 2, 4])
def test_jumps_are_counted(count: int) -> None:
    found = describe(acted.jump(count))
    happens_times(count, "jump", found)
    assert {(jump.side, jump.direction) for jump in found.find("jump")} == {("both", "place")}
    assert not found.find("hop")


@pytest.mark.parametrize("rise", [0.1, 0.2, 0.4])
def test_a_jump_is_as_high_as_the_pelvis_rises(rise: float) -> None:
    (jump,) = describe(acted.jump(rise=rise)).find("jump")
    assert jump.amount == pytest.approx(rise, abs=0.04)


@pytest.mark.parametrize(
    ("speed", "left", "direction"),
    [
        (0.0, 0.0, "place"),
        (1.0, 0.0, "forward"),
        (-1.0, 0.0, "backward"),
        (0.0, 1.0, "left"),
        (0.0, -1.0, "right"),
        (1.0, 0.4, "forward"),
    ],
)
def test_a_jump_has_the_direction_of_its_flight(speed: float, left: float, direction: str) -> None:
    (jump,) = describe(acted.jump(speed=speed, left=left)).find("jump")
    assert jump.direction == direction


@pytest.mark.parametrize("rise", [0.0, 0.02])
def test_feet_that_hardly_leave_the_floor_do_not_jump(rise: float) -> None:
    found = describe(acted.jump(2, rise=rise))
    assert not found.find("jump") and not found.find("hop")


def test_tucked_feet_alone_are_no_jump() -> None:
    """The feet are up, but the pelvis does not rise: a lifted body, or a swing on a bar."""
    frames = 40
    up = 0.3 * acted.bump(frames, 15, 19, 23)
    feet: dict[str, acted.Points] = {side: np.stack([0 * up, up, 0 * up], 1) for side in SIDES}
    assert not describe(acted.Body(frames=frames, feet=feet).joints()).find("jump")


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(
    ("seconds", "height", "found"),
    [(3.0, 0.25, True), (1.4, 0.25, False), (3.0, 0.08, False)],
)
def test_balance_takes_a_second_and_a_lifted_foot(
    side: str, seconds: float, height: float, found: bool
) -> None:
    described = describe(acted.balance(side, seconds, height))
    assert [one.side for one in described.find("balance")] == ([side] if found else [])


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_steps_are_counted(count: int) -> None:
    assert describe(acted.steps(count)).steps == count


def test_a_body_that_marches_takes_no_steps() -> None:
    found = describe(acted.march(5))
    assert found.steps == 0
    assert [(move.kind, move.direction) for move in found.find("walk")] == [("walk", "place")]
    assert found.path.length == 0


@pytest.mark.parametrize(("cycles", "kind"), [(0.8, "walk"), (1.6, "jog")])
def test_quick_steps_in_place_are_a_jog(cycles: float, kind: str) -> None:
    found = describe(acted.march(5, cycles))
    assert {move.kind for move in found.moves if move.direction == "place"} == {kind}


@pytest.mark.parametrize(("seconds", "treads"), [(1.5, False), (3.0, True)])
def test_treading_takes_four_steps(seconds: float, treads: bool) -> None:
    moves = describe(acted.march(seconds)).find("walk")
    assert any(move.direction == "place" for move in moves) is treads


@pytest.mark.parametrize(("down", "direction"), [(False, "up"), (True, "down")])
def test_a_stair_is_climbed(down: bool, direction: str) -> None:
    (climb,) = describe(acted.climb(down=down)).find("climb")
    assert climb.direction == direction
    assert 0.3 < climb.amount <= 0.51


@pytest.mark.parametrize("name", ["walk", "run", "walk a curve", "squat", "jump", "stand"])
def test_flat_floors_are_not_climbed(name: str) -> None:
    assert not acted.scene(name).find("climb")


@pytest.mark.parametrize(
    "name", ["walk", "walk fast", "walk backward", "walk a circle", "jog", "run"]
)
def test_gaits_are_neither_kicks_nor_jumps(name: str) -> None:
    found = acted.scene(name)
    assert not [e for e in found.events if e.kind in ("kick", "jump", "hop", "knee", "balance")]


def test_each_leg_has_its_own_kicks_in_order() -> None:
    found = describe(acted.in_sequence(acted.kick(LEFT, 2), acted.kick(RIGHT)))
    assert [kick.side for kick in found.find("kick")] == [LEFT, LEFT, RIGHT]
