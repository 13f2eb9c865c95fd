"""Checks of instructions on motions of known truth: both what holds and what does not."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.data.instructions import Check, Term, instructions, parse
from latentmotion.errors import InputError
from latentmotion.measure.scene import describe
from latentmotion.training.checking import ACTS, CONDITIONS, events_of, fulfills, validate
from tests.support import acted

# What each motion fulfills.
HOLDS = {
    "stand": ["still(0.9)", "upright", "in_place(0.1)", "stand", "halt", "facing(5)", "step(0, 0)"],
    "walk": ["walk", "go(forward)", "travel(3)", "straight(20)", "move(forward, 3)", "step(8, 12)"],
    "walk slowly": ["speed(0.4, 0.6)", "travel(1)"],
    "walk fast": ["speed(1.6, 2)", "walk"],
    "walk backward": ["go(backward)", "move(backward, 2)", "facing(5)"],
    "walk to the left": ["go(left)", "move(left, 2)", "move(sideways, 2)"],
    "walk to the right": ["go(right)", "move(sideways, 2)"],
    "walk a curve": ["turn(left, 60, 120)", "turn(either, 80, 100) & travel(3)"],
    "walk a circle": ["turn(right, 340, 380) & travel(8)"],
    "jog": ["run", "speed(1.9, 2.3)", "go(forward)"],
    "run": ["run", "speed(2.7, 3.3)", "travel(8) & straight(10)"],
    "turn left": ["turn(left, 80, 100) & in_place(0.2)"],
    "turn around": ["turn(right, 170, 190)", "turn(either, 150, 200)"],
    "march": ["lift_feet(5, 9)", "in_place(0.3)", "step(0, 0)"],
    "three steps": ["step(3, 3)", "move(forward, 0.6)"],
    "jump": ["jump", "jump(1)", "height(0.2)"],
    "jump forward": ["jump & move(forward, 0.2)"],
    "hop twice": ["hop(right, 2)", "jump(2)", "hop(any)"],
    "kick": ["kick(left)", "kick(left, 1)", "kick(any)"],
    "kick to the side": ["kick(right, 2)", "kick(any, 1, 3)"],
    "raise a knee": ["knee_up(right)", "knee_up(any, 1)"],
    "balance": ["one_leg(left)", "one_leg(any)"],
    "raise a hand": ["raise(left)", "raise(any, 1)"],
    "raise both hands": ["raise(both)", "raise(any)"],
    "wave": ["wave(right)"],
    "punch": ["punch(left, 2)"],
    "clap": ["clap(3)", "clap"],
    "squat": ["squat(2)", "crouch", "low"],
    "bow": ["bend", "bend(1)"],
    "pick up": ["reach_down", "bend"],
    "sit down": ["sit", "stand > sit"],
    "lie down": ["lie", "low", "stand > lie"],
    "kneel down": ["kneel", "low"],
    "crouch": ["crouch", "stooped"],
    "jack": ["jack(2)"],
    "crawl": ["crawl", "stooped"],
    "walk, then wave": ["walk > wave", "walk > wave(left)", "go(forward) > wave"],
    "wave, then walk": ["wave > walk", "wave(left) > go(forward)"],
    "walk and stop": ["walk > halt", "slower(1.5)"],
    "walk, then sit down": ["walk > sit", "stand > sit"],
    "turn, then walk": ["turn(left, 60, 120) > walk", "faster(1.5)"],
}

# What each motion does not fulfill.
FAILS = {
    "stand": ["walk", "travel(0.2)", "jump", "sit", "faster(1.1)", "stooped", "lift_feet(1, 9)"],
    "walk": ["run", "go(backward)", "turn(either, 30, 400)", "still(0.3)", "halt", "in_place(1)"],
    "walk slowly": ["speed(0.8, 2)", "run"],
    "walk backward": ["go(forward)", "move(forward, 0.3)"],
    "walk to the left": ["go(right)", "move(right, 0.1)", "go(forward)"],
    "walk a curve": ["turn(right, 10, 400)", "turn(left, 120, 400)", "straight(30)", "facing(60)"],
    "walk a circle": ["turn(left, 90, 4000)", "straight(20)", "turn(right, 90, 200)"],
    "run": ["walk", "in_place(2)", "jump"],
    "march": ["walk", "go(forward)", "still(0.5)"],
    "three steps": ["step(4, 9)", "step(0, 2)"],
    "jump": ["jump(2)", "height(0.5)", "hop(left)"],
    "hop twice": ["hop(left)", "hop(right, 1)", "hop(both)"],
    "kick": ["kick(right)", "kick(left, 2)", "kick(both)", "punch(left)"],
    "balance": ["one_leg(right)"],
    "raise a hand": ["raise(right)", "raise(both)", "wave(left)"],
    "raise both hands": ["raise(left)", "raise(right)"],
    "wave": ["wave(left)", "clap"],
    "punch": ["punch(right)", "punch(left, 1)", "punch(both)"],
    "squat": ["squat(1)", "sit", "lie", "kneel"],
    "sit down": ["lie", "sit_floor", "sit > stand", "kneel"],
    "lie down": ["sit_floor", "kneel", "lie > stand"],
    "walk, then wave": ["wave > walk", "walk > wave(right)"],
    "wave, then walk": ["walk > wave", "wave(right) > walk"],
    "walk and stop": ["halt > walk", "faster(1.1)"],
    "walk, then sit down": ["sit > walk", "walk > lie"],
    "turn, then walk": ["turn(right, 60, 120) > walk", "turn(left, 120, 200) > walk"],
}


def rows(checks: dict[str, list[str]]) -> list[tuple[str, str]]:
    return [(name, text) for name, texts in checks.items() for text in texts]


@pytest.mark.parametrize(("name", "text"), rows(HOLDS))
def test_a_motion_fulfills(name: str, text: str) -> None:
    validate(parse(text))
    assert fulfills(acted.scene(name), parse(text))


@pytest.mark.parametrize(("name", "text"), rows(FAILS))
def test_a_motion_does_not_fulfill(name: str, text: str) -> None:
    validate(parse(text))
    assert not fulfills(acted.scene(name), parse(text))


def test_every_act_and_condition_is_seen_to_hold() -> None:
    held = {term.name for _, text in rows(HOLDS) for term in parse(text).terms}
    poses = {"arms_out", "hands_on_hips", "touch", "sit_floor", "weave"}
    assert held | poses == set(ACTS) | set(CONDITIONS)


@pytest.mark.parametrize(
    ("motion", "text"),
    [
        (acted.hands(3, (0.5, 0.0, 0.0)), "arms_out"),
        (acted.hands(3, (0.08, -0.4, 0.02)), "hands_on_hips"),
        (acted.hands(3, (-0.05, 0.1, 0.1), ("right",)), "touch(right, head)"),
        (acted.lowered("floor"), "sit_floor"),
        (acted.lowered("floor"), "sit"),
        (acted.in_sequence(acted.walk(2), acted.walk(2, 1.0, 180)), "go(forward) > go(backward)"),
        (acted.in_sequence(acted.kick("left"), acted.kick("right")), "kick(left) > kick(right)"),
        (acted.lowered("sit")[::-1], "sit > stand"),
        (acted.in_sequence(acted.walk(2), acted.stand(1), acted.run(3)), "walk > run"),
    ],
)
def test_poses_and_orders(motion: np.ndarray, text: str) -> None:
    scene = describe(motion)
    assert fulfills(scene, parse(text))
    assert not fulfills(acted.scene("stand"), parse(text))
    if ">" in text:
        assert not fulfills(scene, parse(" > ".join(reversed(text.split(" > ")))))


@pytest.mark.parametrize("pause", [0.2, 1.5])
def test_all_terms_of_an_order_follow_each_other(pause: float) -> None:
    parts = [acted.kick("left"), acted.stand(pause), acted.jump(), acted.stand(pause), acted.bow()]
    scene = describe(acted.in_sequence(*parts))
    assert fulfills(scene, parse("kick(left) > jump > bend"))
    for wrong in ("jump > kick > bend", "kick > bend > jump", "bend > jump > kick"):
        assert not fulfills(scene, parse(wrong))


def test_one_kick_of_the_other_leg_is_too_many() -> None:
    scene = describe(acted.in_sequence(acted.kick("left", 2), acted.kick("right")))
    assert not fulfills(scene, parse("kick(left, 2)"))
    assert fulfills(scene, parse("kick(any, 3)"))


def test_a_jump_that_hardly_rises_does_not_count() -> None:
    assert not fulfills(describe(acted.jump(rise=0.09)), parse("jump"))
    assert fulfills(describe(acted.jump(rise=0.2)), parse("jump"))


@pytest.mark.parametrize(
    ("term", "kinds"),
    [
        (Term("turn", ("left",), (60, 120)), ["turn"]),
        (Term("turn", ("left",), (120, 200)), []),
        (Term("turn", ("right",), (60, 120)), []),
        (Term("turn", ("either",), (60, 120)), ["turn"]),
        (Term("go", ("forward",)), ["walk"]),
        (Term("go", ("left",)), []),
        (Term("walk"), ["walk"]),
    ],
)
def test_events_of_a_term(term: Term, kinds: list[str]) -> None:
    assert [event.kind for event in events_of(acted.scene("walk a curve"), term)] == kinds


@pytest.mark.parametrize(
    ("text", "check"),
    [
        ("walk", Check((Term("walk"),))),
        ("kick(right, 2)", Check((Term("kick", ("right",), (2,)),))),
        ("turn(left, 60, 120)", Check((Term("turn", ("left",), (60, 120)),))),
        ("a&b(1)", Check((Term("a"), Term("b", (), (1,))))),
        ("walk > sit", Check((Term("walk"), Term("sit")), True)),
        ("speed( 0.5 , 1.8 )", Check((Term("speed", (), (0.5, 1.8)),))),
        ("touch(left, head)", Check((Term("touch", ("left", "head")),))),
    ],
)
def test_expressions_are_read_and_written(text: str, check: Check) -> None:
    assert parse(text) == check
    assert parse(str(check)) == check


@pytest.mark.parametrize(
    ("term", "often"),
    [(Term("a"), (1, np.inf)), (Term("a", (), (2,)), (2, 2)), (Term("a", (), (2, 5)), (2, 5))],
)
def test_how_often_a_term_demands(term: Term, often: tuple[float, float]) -> None:
    assert term.often == often


@pytest.mark.parametrize(
    "text",
    ["", "kick()x", "kick(left", "a & > b", "kick(2, left)", "a > b & c", "Kick", "walk >", "a b"],
)
def test_ill_formed_expressions_are_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse(text)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("kik", "kick"),
        ("kick(lft)", "left"),
        ("travel", "expected 1 numbers"),
        ("travel(1, 2)", "expected 1 numbers"),
        ("move(0.5)", "expected 1 words"),
        ("kick(left, right)", "expected 1 words"),
        ("kick(left, 3, 2)", "smaller number first"),
        ("kick(left, 1, 2, 3)", "fewer numbers"),
        ("kick(left, 2) > walk", "fewer numbers"),
        ("still(0.7) > walk", "unknown 'still'"),
        ("go(up)", "unknown word 'up'"),
        ("upright(3)", "expected 0 numbers"),
    ],
)
def test_wrong_terms_are_refused_with_a_hint(text: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        validate(parse(text))


def test_the_list_asks_for_what_standing_does_not_show() -> None:
    """A model that never moves must not score: only checks of stillness hold."""
    scene = acted.scene("stand")
    held = [one.prompt for one in instructions() if fulfills(scene, one.check)]
    assert len(held) < 0.06 * len(instructions())
    assert any("still" in prompt for prompt in held)
