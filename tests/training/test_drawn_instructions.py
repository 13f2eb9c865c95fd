"""Drawn instructions: their checks ask for what their sentences say, no more and no less."""

from __future__ import annotations

import re
from collections import Counter

import pytest

from latentmotion.data.instructions import GROUPS, Instruction, instructions, refused_captions
from latentmotion.language.reading import claims_of
from latentmotion.language.words import plain
from latentmotion.training.checking import validate
from latentmotion.training.drawn_instructions import SHARES, drawn_instructions

DRAWN = drawn_instructions(300, seed=11)
LEFT, RIGHT = (
    r"\bleft\b|counter-?clockwise|anticlockwise",
    r"\bright\b|(?<!counter)(?<!counter-)\bclockwise",
)
NUMBERS = {"twice": 2, "two": 2, "three": 3, "four": 4, "2": 2, "3": 3, "4": 4}


def of_group(group: str) -> list[Instruction]:
    return [one for one in DRAWN if one.group == group]


def says(text: str, words: str) -> bool:
    return bool(re.search(words, text.lower()))


def test_shares_of_groups() -> None:
    assert set(SHARES) == set(GROUPS) and sum(SHARES.values()) == pytest.approx(1)
    counts = Counter(one.group for one in DRAWN)
    for group, share in SHARES.items():
        assert counts[group] / len(DRAWN) == pytest.approx(share, abs=0.06)


def test_names_and_sentences_are_different() -> None:
    assert len({one.id for one in DRAWN}) == len({one.prompt for one in DRAWN}) == len(DRAWN)
    few = drawn_instructions(20, seed=5)
    assert drawn_instructions(20, seed=5) == few
    assert {one.prompt for one in drawn_instructions(20, seed=6)} != {one.prompt for one in few}


def test_no_sentence_is_of_the_benchmark() -> None:
    refused = refused_captions()
    assert not [one for one in DRAWN if plain(one.prompt) in refused]
    assert {plain(one.prompt) for one in instructions()} <= refused


@pytest.mark.parametrize("group", GROUPS)
def test_checks_are_valid_and_of_their_group(group: str) -> None:
    drawn = of_group(group)
    assert drawn
    for one in drawn:
        validate(one.check)
        assert one.check.ordered is (group == "order") or group == "posture"
        assert len(one.prompt) > 3 and not re.search(r"[\[\]|~<>{}]", one.prompt)


@pytest.mark.parametrize("group", ["side", "turns", "counts", "direction"])
def test_a_side_that_is_said_is_demanded(group: str) -> None:
    for one in of_group(group):
        check = str(one.check)
        left, right = says(one.prompt, LEFT), says(one.prompt, RIGHT)
        if re.search(r"\b(?:left|right)\b", check):
            assert ("left" in check, "right" in check) == (left, right), one
        if left != right and not says(one.prompt, "both|and right|and left"):
            assert ("left" in check) is left and ("right" in check) is right, one


def test_counts_that_are_said_are_demanded() -> None:
    seen = 0
    for one in of_group("counts"):
        said = {
            NUMBERS[word]
            for word in re.findall(r"[a-z]+|\d", one.prompt.lower())
            if word in NUMBERS
        }
        if len(said) == 1 and not says(one.prompt, "in turn|one after|step"):
            (count,) = said
            least, most = one.check.terms[0].often
            assert least <= count <= most, one
            seen += 1
    assert seen > 20


@pytest.mark.parametrize(
    ("words", "often"),
    [(r"\b(?:several|repeatedly|again and again)\b", (3, 99)), (r"\ba few\b", (2, 5))],
)
def test_vague_counts_demand_a_range(words: str, often: tuple[float, float]) -> None:
    vague = [one for one in of_group("counts") if says(one.prompt, words)]
    assert vague
    assert {one.check.terms[0].often for one in vague} == {often}


def test_orders_have_two_acts_that_the_sentence_names() -> None:
    stems = {
        "kick": "kick", "punch": "punch|jab|hit|strik|hook|box", "wave": "wav|greet|hello|goodbye",
        "jump": "jump|leap|spring|hop", "turn": "turn|rotat|pivot|spin|swivel|face|180|back",
        "sit": "sit|seat|settl|lower|sat", "squat": "squat|knee bend|bend|knees",
    }  # fmt: skip
    for one in of_group("order"):
        assert len(one.check.terms) == 2
        for term in one.check.terms:
            assert term.name not in stems or says(one.prompt, stems[term.name]), one


def test_turns_demand_their_degrees() -> None:
    for one in of_group("turns"):
        least, most = one.check.terms[0].often
        for claim in claims_of(one.prompt):
            if claim.kind == "turn" and claim.degrees >= 45:
                assert least <= claim.degrees <= most, one


def test_paces_are_demanded_as_speeds() -> None:
    slow = [one for one in of_group("pace") if says(one.prompt, r"^(?!.*run|.*jog).*\bslow")]
    for one in slow:
        assert "speed(0.1, 0.9)" in str(one.check), one
    sprints = [one for one in of_group("pace") if says(one.prompt, "sprint|full speed")]
    for one in sprints:
        assert "speed(2.8, 11)" in str(one.check), one
    assert slow or sprints


@pytest.mark.parametrize("count", [0, 1, 20])
def test_at_most_as_many_as_asked(count: int) -> None:
    drawn = drawn_instructions(count, seed=0)
    assert len(drawn) <= count
    assert [one.id for one in drawn] == [f"drawn-0-{n:05d}" for n in range(len(drawn))]
