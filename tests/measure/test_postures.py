"""Postures and the changes between them; squats, bows, reaches to the floor; stillness."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from latentmotion.measure.facts import Event
from latentmotion.measure.scene import describe
from latentmotion.measure.whole_body import changes_of, stillness
from tests.support import acted

DOWN = {"sit": "sit_down", "floor": "sit_down", "lie": "lie_down", "kneel": "kneel_down"}
UP = {"sit": "stand_up", "floor": "get_up", "lie": "get_up", "kneel": "stand_up"}


@pytest.mark.parametrize("posture", ["sit", "floor", "lie", "kneel", "crouch", "bend"])
def test_a_posture_that_is_held(posture: str) -> None:
    found = describe(acted.held(posture))
    assert [one.kind for one in found.postures] == [posture]
    assert [one.frames for one in found.find(posture)] == [found.frames]
    assert not found.events


@pytest.mark.parametrize("posture", DOWN)
def test_going_down_is_one_change(posture: str) -> None:
    found = describe(acted.lowered(posture))
    assert (found.postures[0].kind, found.postures[-1].kind) == ("stand", posture)
    assert [event.kind for event in found.events] == [DOWN[posture]]
    (change,) = found.events
    assert 0 < change.start < change.end < 45


@pytest.mark.parametrize("posture", UP)
def test_going_down_backward_is_getting_up(posture: str) -> None:
    found = describe(acted.lowered(posture)[::-1])
    assert (found.postures[0].kind, found.postures[-1].kind) == (posture, "stand")
    assert [event.kind for event in found.events] == [UP[posture]]


@pytest.mark.parametrize("posture", ["crouch", "bend"])
def test_crouching_and_bending_are_no_change(posture: str) -> None:
    found = describe(acted.lowered(posture))
    assert found.postures[-1].kind == posture
    assert not [event for event in found.events if event.kind in {*DOWN.values(), *UP.values()}]


def postures(*kinds: str, frames: int = 30) -> tuple[Event, ...]:
    return tuple(Event(kind, n * frames, (n + 1) * frames) for n, kind in enumerate(kinds))


@pytest.mark.parametrize(
    ("kinds", "changes"),
    [
        (("stand", "crouch", "sit"), ["sit_down"]),
        (("stand", "bend", "stand"), []),
        (("stand", "crouch", "kneel", "lie"), ["lie_down"]),
        (("stand", "sit", "lie"), ["lie_down"]),
        (("lie", "floor", "stand"), ["get_up"]),
        (("lie", "sit", "stand"), ["sit_up", "stand_up"]),
        (("sit", "stand", "sit"), ["stand_up", "sit_down"]),
        (("stand",), []),
        (("sit", "floor"), []),
    ],
)
def test_halves_of_a_change_are_one(kinds: tuple[str, ...], changes: list[str]) -> None:
    assert [event.kind for event in changes_of(postures(*kinds))] == changes


@pytest.mark.parametrize("below", ["lie", "floor"])
def test_getting_up_may_pass_the_height_of_a_seat(below: str) -> None:
    (change,) = changes_of(postures(below, "sit", "stand", frames=10))
    assert (change.kind, change.start, change.end) == ("get_up", 4, 26)


def test_a_long_rest_divides_a_change() -> None:
    found = changes_of(postures("stand", "sit", "lie", frames=80))
    assert [event.kind for event in found] == ["sit_down", "lie_down"]


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize(("kind", "make"), [("squat", acted.squat), ("bow", acted.bow)])
def test_squats_and_bows_are_counted(
    kind: str, make: Callable[..., np.ndarray], count: int
) -> None:
    found = describe(make(count))
    assert [event.kind for event in found.events] == [kind] * count


@pytest.mark.parametrize(("depth", "count"), [(0.12, 0), (0.3, 1), (0.45, 1)])
def test_a_squat_is_deep(depth: float, count: int) -> None:
    squats = describe(acted.squat(1, depth)).find("squat")
    assert len(squats) == count
    for squat in squats:
        assert squat.amount == pytest.approx(depth + 0.04, abs=0.02)


@pytest.mark.parametrize(("degrees", "count"), [(30, 0), (60, 1), (80, 1)])
def test_a_bow_is_deep(degrees: float, count: int) -> None:
    bows = describe(acted.bow(1, degrees)).find("bow")
    assert len(bows) == count
    for bow in bows:
        assert (bow.direction, bow.amount) == ("forward", pytest.approx(degrees, abs=2))


@pytest.mark.parametrize("side", ["left", "right", "both"])
def test_a_reach_to_the_floor_has_the_lower_hand(side: str) -> None:
    (reach,) = describe(acted.pick_up(side)).find("pick_up")
    assert reach.side == side
    assert reach.amount < 0.3


def test_who_goes_down_for_good_neither_squats_nor_bows() -> None:
    for posture in ("sit", "lie", "kneel", "crouch", "bend"):
        assert not describe(acted.lowered(posture)).find("squat")
        assert not describe(acted.lowered(posture)).find("bow")


def test_crawling_is_low_and_level() -> None:
    (crawl,) = acted.scene("crawl").all_of("crawl")
    assert crawl.frames == acted.scene("crawl").frames
    for name in ("kneel down", "lie down", "bow", "crouch", "walk"):
        assert not acted.scene(name).all_of("crawl")


@pytest.mark.parametrize(
    ("name", "least", "most"), [("stand", 1, 1), ("walk", 0, 0), ("walk and stop", 0.3, 0.45)]
)
def test_stillness_is_a_share_of_the_frames(name: str, least: float, most: float) -> None:
    assert least <= stillness(acted.scene(name).signals).mean() <= most


@pytest.mark.parametrize(("slowest", "still"), [(0.05, False), (2.0, True)])
def test_stillness_is_below_a_speed(slowest: float, still: bool) -> None:
    slow = acted.raise_hand("left", 1, (0.0, -0.1, 0.45))
    assert bool(stillness(describe(slow).signals, slowest).all()) is still


def test_a_body_on_a_lower_floor_is_described_alike() -> None:
    """A floor that is a little off is corrected; a body in the air is set on the floor."""
    one = describe(acted.lowered("sit"))
    for offset in (-0.04, 0.04, 0.9):
        other = describe(acted.lowered("sit") + np.array([0, offset, 0]))
        assert [p.kind for p in other.postures] == [p.kind for p in one.postures]
