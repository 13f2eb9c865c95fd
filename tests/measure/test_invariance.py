"""Descriptions do not depend on place and heading, and a mirror exchanges left and right alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.measure.facts import Event
from latentmotion.measure.scene import Measured, describe
from tests.support import acted

SWAPPED = {"left": "right", "right": "left"}


def facts_of(scene: Measured) -> list[Event]:
    """All facts with their frames; amounts to a hundredth."""
    found = (*scene.moves, *scene.turns, *scene.postures, *scene.events)
    every = [replace(one, amount=round(one.amount, 2)) for one in (*found, *scene.poses)]
    return sorted(every, key=lambda one: (one.start, one.end, one.kind, one.side))


def swapped(events: list[Event]) -> list[Event]:
    exchanged = [
        replace(
            one,
            side=SWAPPED.get(one.side, one.side),
            direction=SWAPPED.get(one.direction, one.direction),
        )
        for one in events
    ]
    return sorted(exchanged, key=lambda one: (one.start, one.end, one.kind, one.side))


@pytest.mark.parametrize("name", acted.MOTIONS)
def test_place_and_heading_do_not_matter(name: str) -> None:
    joints = acted.MOTIONS[name]()
    for degrees in (130, -77):
        other = describe(acted.elsewhere(joints, degrees))
        assert facts_of(other) == facts_of(acted.scene(name))
        assert other.steps == acted.scene(name).steps
        assert other.path.turned == pytest.approx(acted.scene(name).path.turned)


@pytest.mark.parametrize("name", acted.MOTIONS)
def test_a_mirror_exchanges_left_and_right(name: str) -> None:
    joints, one = acted.MOTIONS[name](), acted.scene(name)
    other = describe(acted.mirrored(joints))
    assert facts_of(other) == swapped(facts_of(one))
    assert other.path.left == pytest.approx(-one.path.left, abs=1e-6)
    assert other.path.length == pytest.approx(one.path.length)
    assert other.twist == pytest.approx(one.twist[::-1], abs=1e-3)


def test_a_mirror_in_a_mirror_is_no_mirror() -> None:
    joints = acted.kick("left")
    assert (acted.mirrored(acted.mirrored(joints)) == joints).all()


@pytest.mark.parametrize(
    "make",
    [
        acted.kick,
        acted.knee_up,
        acted.raise_hand,
        acted.punch,
        acted.wave,
        acted.hop,
        acted.pick_up,
    ],
)
def test_the_other_side_is_acted_as_a_mirror_shows_it(make) -> None:
    """The acted motions themselves: the right side is not only a mirrored left one."""
    right, mirror = describe(make("right")), describe(acted.mirrored(make("left")))
    kinds = [(one.kind, one.side, one.direction, one.count) for one in facts_of(right)]
    assert kinds == [(one.kind, one.side, one.direction, one.count) for one in facts_of(mirror)]


@pytest.mark.parametrize("name", ["walk", "kick", "wave", "sit down", "jump", "run", "turn left"])
def test_small_noise_does_not_matter(name: str) -> None:
    joints = acted.MOTIONS[name]()
    noise = np.random.default_rng(0).normal(0, 0.002, joints.shape)
    shown = [(one.kind, one.side) for one in facts_of(acted.scene(name))]
    assert [(one.kind, one.side) for one in facts_of(describe(joints + noise))] == shown
