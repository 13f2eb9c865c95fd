"""Detectors of the instruction benchmark on made-up motions that do one known thing."""

from __future__ import annotations

import re

import numpy as np
import pytest

from latentmotion.data.instructions import GROUPS, parse
from latentmotion.errors import InputError
from latentmotion.evaluation.instructions.benchmark import instructions
from latentmotion.evaluation.instructions.detectors import (
    ACTS,
    CONDITIONS,
    Body,
    fulfills,
    spans,
    swings,
)
from tests.support import acted

MOTIONS = {
    "stand": acted.stand(3),
    "walk": acted.walk(),
    "walk slowly": acted.walk(4, 0.5),
    "walk fast": acted.walk(4, 1.7),
    "walk backward": acted.walk(4, 0.8, 180),
    "walk to the left": acted.walk(4, 0.8, 90),
    "walk a curve": acted.walk(4, 1.0, turn=90),
    "walk a circle": acted.walk(8, 1.2, turn=-360),
    "run": acted.run(),
    "turn around": acted.turn_in_place(-180),
    "march": acted.march(),
    "two steps": acted.steps(2),
    "jump": acted.jump(1),
    "jump three times": acted.jump(3),
    "hop": acted.hop("left", 3),
    "kick left": acted.kick("left"),
    "kick right twice": acted.kick("right", 2),
    "lift the knee": acted.knee_up("left", 2),
    "balance": acted.balance("right"),
    "raise left": acted.raise_hand("left"),
    "raise right": acted.raise_hand("right", 3),
    "wave": acted.wave("left"),
    "punch": acted.punch("right", 2),
    "clap": acted.clap(3),
    "squat": acted.squat(2),
    "bow": acted.bow(2),
    "pick up": acted.pick_up("left"),
    "sit": acted.lowered("sit"),
    "jacks": acted.jack(2),
    "crawl": acted.crawl(),
    "walk, then kick": acted.in_sequence(acted.walk(2), acted.kick("left")),
    "kick, then jump": acted.in_sequence(acted.kick("left"), acted.jump(1)),
    "kick left, then right": acted.in_sequence(acted.kick("left"), acted.kick("right")),
}

HOLDS = {
    "stand": "still & motionless & upright",
    "walk": "walk & go(forward) & pace(0.7, 1.5) & heads(forward) & net(either, 0, 20)",
    "walk slowly": "walk & pace(0.2, 0.95)",
    "walk fast": "walk & pace(1.15, 2.5)",
    "walk backward": "go(backward) & heads(backward)",
    "walk to the left": "go(left) & heads(left) & heads(sideways)",
    "walk a curve": "net(left, 60, 120) & turn(left)",
    "walk a circle": "net(right, 300, 400) & way(4)",
    "run": "run & pace(2, 9)",
    "turn around": "net(right, 150, 210) & stays(0.3)",
    "march": "on_the_spot",
    "two steps": "step(2, 3)",
    "jump": "jump(1)",
    "jump three times": "jump(3)",
    "hop": "hop(left, 3)",
    "kick left": "kick(left, 1)",
    "kick right twice": "kick(right, 2)",
    "lift the knee": "knee(left, 2)",
    "balance": "one_leg(right)",
    "raise left": "raise(left)",
    "raise right": "raise(right, 3)",
    "wave": "wave(left)",
    "punch": "punch(right, 2)",
    "clap": "clap(3)",
    "squat": "squat(2)",
    "bow": "bow(2)",
    "pick up": "reach_floor",
    "sit": "sit",
    "jacks": "jack(2)",
    "crawl": "crawl",
    "walk, then kick": "walk > kick(left)",
    "kick, then jump": "kick > jump",
    "kick left, then right": "kick(left) > kick(right)",
}

FAILS = {
    "stand": ["walk", "turn", "jump", "kick", "raise", "wave", "punch", "sit", "on_the_spot"],
    "walk": ["run", "go(backward)", "go(left)", "turn", "jump", "kick", "still", "on_the_spot"],
    "walk slowly": ["pace(1.15, 2.5)", "run"],
    "walk fast": ["run", "pace(0.2, 0.95)"],
    "walk backward": ["go(forward)", "turn"],
    "walk a curve": ["net(right, 60, 120)", "turn(right)"],
    "run": ["walk", "jump", "kick"],
    "jump three times": ["jump(2)", "hop", "on_the_spot", "squat(1)"],
    "hop": ["jump(3, 99) & hop(right)", "hop(right)"],
    "kick left": ["kick(right)", "knee(right)", "jump"],
    "kick right twice": ["kick(right, 1)", "kick(left)"],
    "balance": ["one_leg(left)"],
    "raise left": ["raise(right)", "raise(both)", "punch"],
    "wave": ["wave(right)", "wave(both)", "punch"],
    "punch": ["punch(left)", "punch(right, 3)", "kick", "raise"],
    "sit": ["lie", "low"],
    "walk, then kick": ["kick(left) > walk", "kick(right)"],
    "kick, then jump": ["jump > kick"],
    "kick left, then right": ["kick(right) > kick(left)", "kick(left)", "kick(right)"],
}  # fmt: skip


@pytest.mark.parametrize("name", HOLDS)
def test_what_a_motion_does_is_found(name: str) -> None:
    assert fulfills(Body(MOTIONS[name]), parse(HOLDS[name]))


@pytest.mark.parametrize(("name", "check"), [(n, c) for n, every in FAILS.items() for c in every])
def test_what_it_does_not_do_is_not_found(name: str, check: str) -> None:
    assert not fulfills(Body(MOTIONS[name]), parse(check))


SIDED = ["walk a curve", "kick left", "hop", "lift the knee", "balance", "raise left", "wave"]


@pytest.mark.parametrize("name", SIDED)
def test_a_mirrored_motion_does_it_with_the_other_side(name: str) -> None:
    check = HOLDS[name].replace("left", "?").replace("right", "left")
    mirrored = Body(acted.mirrored(MOTIONS[name]))
    assert fulfills(mirrored, parse(check.replace("?", "right")))
    assert not fulfills(mirrored, parse(HOLDS[name]))


@pytest.mark.parametrize("name", HOLDS)
def test_place_and_front_of_the_start_do_not_matter(name: str) -> None:
    assert fulfills(Body(acted.elsewhere(MOTIONS[name], 130)), parse(HOLDS[name]))


def test_every_prompt_has_a_check_of_known_acts() -> None:
    listed = instructions()
    assert len(listed) == 252 and {one.group for one in listed} == set(GROUPS)
    for one in listed:
        assert {term.name for term in one.check.terms} <= {*ACTS, *CONDITIONS}
        assert isinstance(fulfills(Body(MOTIONS["walk"]), one.check), bool)
        sides = set(re.findall(r"\b(?:left|right)\b", one.prompt))
        if len(sides) == 1 and one.group == "side":
            assert re.search(rf"\({sides.pop()}", str(one.check)), one


def test_unknown_acts_are_refused() -> None:
    with pytest.raises(InputError, match=r"unknown act 'kik'.*kick"):
        fulfills(Body(MOTIONS["stand"]), parse("kik(left)"))


def test_events_of_curves() -> None:
    curve = np.array([0, 0.4, 1.2, 0.6, 1.3, 0.1, 2.0])
    assert swings(curve, 0.5, 1.0) == [(2, 5), (6, 7)]
    holds = np.array([1, 1, 0, 1, 0, 0, 0, 1], bool)
    assert spans(holds) == [(0, 2), (3, 4), (7, 8)]
    assert spans(holds, 0.15, 0.05) == [(0, 4)]
