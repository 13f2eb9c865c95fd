"""Patterns of prompts: alternatives, counts, sides, degrees; and inflected verbs."""

from __future__ import annotations

import re

import numpy as np
import pytest

from latentmotion.language.reading import claims_of
from latentmotion.language.words import inflect
from latentmotion.measure.facts import SingleAction
from latentmotion.training.captioning.clauses import VERBS, other_number
from latentmotion.training.captioning.prompting import (
    Wording,
    clockwise,
    contrasted,
    kinds,
    number,
    prompts,
    some,
    times,
    wording,
)


def action(kind: str, **fields: object) -> SingleAction:
    return SingleAction(kind, 0, 60, **fields)  # type: ignore[arg-type]


def told(one: SingleAction, count: int = 60, seed: int = 0) -> list[str]:
    return [text.lower() for text in prompts(one, np.random.default_rng(seed), count)]


def alternatives(pattern: str) -> set[str]:
    """All texts of one pair of brackets."""
    match = re.fullmatch(r"(.*?)\[([^\[\]]*)\](.*)", pattern)
    return {f"{match[1]}{one}{match[3]}" for one in match[2].split("|")} if match else {pattern}


@pytest.mark.parametrize(
    ("count", "shown", "never"),
    [
        (1, {"", "once", "one time"}, {"twice"}),
        (2, {"twice", "two times", "2 times", "a couple of times"}, {"several times"}),
        (4, {"several times"}, {"a few times", "repeatedly"}),
        (7, {"again and again", "repeatedly"}, {"a few times"}),
    ],
)
def test_how_often(count: int, shown: set[str], never: set[str]) -> None:
    texts = alternatives(times(count)) if count < 3 else {times(count)}
    found = " / ".join(texts)
    for word in shown:
        assert word in texts or word in found
    assert not [word for word in never if word in found]


def test_numbers_are_words_or_digits() -> None:
    assert alternatives(number(3)) == {"three", "3"}
    assert number(14) == "14"
    assert some(1, "kick", "kicks").endswith("kick")
    assert "kicks" in some(3, "kick", "kicks") and "a few" in some(3, "kick", "kicks")


def test_sides_of_turns() -> None:
    assert "counterclockwise" in clockwise("left") and clockwise("right") == "clockwise"
    sides = [
        wording(action("turn", side=side, degrees=90.0)).clauses[0] for side in ("left", "right")
    ]
    assert "left" in sides[0] and "right" not in sides[0]
    assert sides[1] == sides[0].replace("left", "right")


@pytest.mark.parametrize("kind", kinds())
def test_every_condition_of_a_table_can_be_met(kind: str) -> None:
    shown = [
        wording(action(kind, side=side, direction=direction, count=count, degrees=degrees))
        for side in ("left", "both")
        for direction in ("", "forward", "backward", "left", "up")
        for count in (1, 3)
        for degrees in (20.0, 90.0, 180.0, 300.0, 800.0)
    ]
    texts = {text for words in shown for text in (*words.clauses, *words.nouns, *words.people)}
    assert texts and not [text for text in texts if re.search(r"[{};/]", text)]


@pytest.mark.parametrize("kind", kinds())
def test_brackets_are_balanced(kind: str) -> None:
    words = wording(action(kind, side="left", count=2, degrees=90, gait="walk", pace="normal"))
    assert isinstance(words, Wording)
    for text in (*words.clauses, *words.nouns, *words.after, *words.orders):
        depth = 0
        for letter in text:
            depth += {"[": 1, "]": -1}.get(letter, 0)
            assert 0 <= depth <= 3, text
        assert depth == 0, text
        assert set(re.findall(r"<\w+>", text)) <= {
            "<his>",
            "<him>",
            "<he>",
            "<is>",
            "<the>",
            "<himself>",
        }
    for text in words.clauses:
        assert "~" in text, text
    assert not [text for text in words.nouns if "~" in text]


SIDES = [
    ("kick", "leg|foot|kick"),
    ("punch", "hand|fist|arm|punch|jab|hook"),
    ("wave", "hand|arm|wave"),
    ("raise", "hand|arm"),
    ("hop", "leg|foot|hop"),
    ("knee", "knee"),
    ("balance", "leg|foot"),
    ("pick_up", "hand|up|floor|ground"),
    ("arm_circle", "arm|circle"),
    ("touch_head", "head|hair"),
]


@pytest.mark.parametrize(("kind", "limb"), SIDES)
@pytest.mark.parametrize("side", ["left", "right", "both"])
def test_patterns_of_limbs_name_the_side(kind: str, limb: str, side: str) -> None:
    words = wording(action(kind, side=side))
    other = {"left": r"\bright\b", "right": r"\bleft\b", "both": "^$"}[side]
    for text in (*words.clauses, *words.nouns):
        assert not re.search(other, text), text
    texts = [text for text in (*words.clauses, *words.nouns) if side in text]
    assert texts or side == "both"
    assert all(re.search(limb, text) for text in texts)


@pytest.mark.parametrize(
    ("kind", "fields", "claimed"),
    [
        ("kick", {"side": "left"}, {"kick": "left"}),
        ("punch", {"side": "right"}, {"punch": "right"}),
        ("hop", {"side": "left"}, {"hop": "left"}),
        ("raise", {"side": "right", "direction": "up"}, {"raise": "right"}),
        ("knee", {"side": "left"}, {"knee": "left"}),
        ("turn", {"side": "left", "degrees": 90.0}, {"turn": "left"}),
        ("turn", {"side": "right", "degrees": 45.0, "gait": "walk"}, {"turn": "right"}),
        ("circle", {"side": "left", "degrees": 330.0, "gait": "walk"}, {"circle": "left"}),
    ],
)
def test_prompts_claim_no_other_side(
    kind: str, fields: dict[str, object], claimed: dict[str, str]
) -> None:
    sides = [
        one.side
        for text in told(action(kind, **fields))
        for one in claims_of(text)
        if one.kind in claimed
    ]
    assert set(sides) <= {"", *claimed.values()}
    assert sides.count(claimed[kind]) > 0.4 * len(sides)


@pytest.mark.parametrize(
    ("direction", "always", "never"),
    [
        ("backward", r"back|reverse|retreat", r"forward|ahead|left|right"),
        ("left", r"left|sideways", r"forward|right|back"),
        ("right", r"right|sideways", r"forward|left|back"),
        ("forward", r"", r"\bback|left|right|sideways"),
    ],
)
def test_gaits_are_told_in_their_direction(direction: str, always: str, never: str) -> None:
    texts = told(action("walk", direction=direction, pace="normal"))
    assert all(re.search(always, text) for text in texts)
    assert not [text for text in texts if re.search(never, text)]


@pytest.mark.parametrize(("kind", "pace"), [("walk", "slow"), ("walk", "fast"), ("run", "fast")])
def test_a_pace_changes_the_words(kind: str, pace: str) -> None:
    slow, fast = (
        r"slow|stroll|saunter|amble|leisure|plod|hurry",
        r"fast|quick|brisk|sprint|rush|hurr",
    )
    texts = told(action(kind, direction="forward", pace=pace))
    wanted = slow if pace == "slow" else fast + r"|dash|speed|race|power|strid"
    assert np.mean([bool(re.search(wanted, text)) for text in texts]) > 0.8


def test_a_jog_has_no_pace_of_its_own() -> None:
    fast = wording(action("jog", direction="forward", pace="fast"))
    run = wording(action("run", direction="forward", pace="normal"))
    assert list(fast.clauses) == list(run.clauses)


@pytest.mark.parametrize(
    ("degrees", "words"),
    [(20, "slight"), (45, "45"), (90, "quarter"), (120, "far"), (180, "half turn"), (200, "about")],
)
def test_turns_have_the_words_of_their_degrees(degrees: float, words: str) -> None:
    turn = wording(action("turn", side="right", degrees=degrees))
    clauses, nouns = turn.clauses, turn.nouns
    assert any(words in text for text in clauses)
    assert clauses and nouns
    assert not [text for text in (*clauses, *nouns) if re.search(r"\bleft\b|counterclock", text)]


def test_far_turns_while_walking_are_circles() -> None:
    turn = wording(action("turn", side="left", degrees=300.0, gait="walk"))
    circle = wording(action("circle", side="left", degrees=300.0, gait="walk"))
    assert list(turn.clauses) == list(circle.clauses)


@pytest.mark.parametrize(
    ("first", "second", "shown"),
    [
        (action("kick", side="left"), action("kick", side="right"), "kick left, then right"),
        (
            action("wave", side="right"),
            action("wave", side="left"),
            "the right hand, then the left",
        ),
        (action("kick", side="left", count=2), action("kick", side="right"), ""),
        (action("kick", side="left"), action("kick", side="left"), ""),
        (action("kick", side="left"), action("punch", side="right"), ""),
        (
            action("walk", direction="forward", pace="normal"),
            action("walk", direction="backward", pace="normal"),
            "forward",
        ),
        (
            action("walk", direction="forward", pace="slow"),
            action("walk", direction="backward", pace="fast"),
            "",
        ),
    ],
)
def test_contrasts_name_the_act_once(first: SingleAction, second: SingleAction, shown: str) -> None:
    texts = contrasted(first, second)
    assert bool(texts) is bool(shown)
    assert not shown or any(shown in re.sub(r"[~<>]", "", text) for text in texts)


POSTURES = [
    *("walk_to_run", "run_to_walk", "march", "jog_in_place", "arms_out", "hands_on_hips", "sit"),
    *("sit_down", "stand_up", "sit_floor", "lie_down", "lie", "get_up", "kneel", "crawl", "sneak"),
    "stand",
]


@pytest.mark.parametrize("kind", POSTURES)
def test_postures_have_no_sides_and_no_counts(kind: str) -> None:
    words = wording(action(kind, side="left", count=2))
    for text in (*words.clauses, *words.nouns):
        assert not re.search(r"\b(?:left|right|twice|once|\d)\b", text), text


@pytest.mark.parametrize(
    ("verb", "third", "participle", "past"),
    [
        ("walk", "walks", "walking", "walked"),
        ("run", "runs", "running", "ran"),
        ("go", "goes", "going", "went"),
        ("lie", "lies", "lying", "lay"),
        ("be", "is", "being", "was"),
        ("try", "tries", "trying", "tried"),
        ("jump", "jumps", "jumping", "jumped"),
        ("clap", "claps", "clapping", "clapped"),
        ("raise", "raises", "raising", "raised"),
        ("stretch", "stretches", "stretching", "stretched"),
        ("zigzag", "zigzags", "zigzagging", "zigzagged"),
        ("kneel", "kneels", "kneeling", "knelt"),
        ("bow", "bows", "bowing", "bowed"),
    ],
)
def test_verbs_are_inflected(verb: str, third: str, participle: str, past: str) -> None:
    forms = [inflect(verb, form) for form in ("third", "participle", "past", "base")]
    assert forms == [third, participle, past, verb]


def test_every_verb_has_three_different_forms() -> None:
    assert len(set(VERBS)) == len(VERBS) > 300
    for verb in VERBS:
        forms = {inflect(verb, form) for form in ("third", "participle")} | {verb}
        assert len(forms) == 3, verb
        assert inflect(verb, "past").isascii() and " " not in inflect(verb, "past")


@pytest.mark.parametrize(
    ("text", "other"),
    [
        ("take three steps", "take 3 steps"),
        ("jump 4 times", "jump four times"),
        ("walk ten laps, then 2 circles", "walk 10 laps, then two circles"),
        ("hold two boxes", "hold two boxes"),
        ("turn 90 degrees", "turn 90 degrees"),
    ],
)
def test_numbers_are_written_the_other_way(text: str, other: str) -> None:
    assert other_number(text) == other
    assert other_number(other) == text
