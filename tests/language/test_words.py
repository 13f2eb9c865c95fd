"""Tokens, numbers in words, patterns and forms of verbs."""

from __future__ import annotations

import pytest

from latentmotion.language.reading import request_of
from latentmotion.language.words import (
    at_once,
    clauses_of,
    forms,
    inflect,
    match,
    plain,
    tokens_of,
    uncounted,
    with_words,
    words_of,
)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("7", 7), ("twelve", 12), ("forty-five", 45), ("a hundred", 100), ("one-eighty", 180),
        ("three sixty", 360), ("a hundred and eighty", 180), ("two hundred seventy", 270),
        ("a dozen", 12), ("half a dozen", 6), ("a couple of", 2), ("a pair of", 2), ("thrice", 3),
        ("one and a half", 1.5), ("seven twenty", 720), ("two hundred and five", 205),
    ],
)  # fmt: skip
def test_numbers_in_words(text: str, number: float) -> None:
    (token,) = tokens_of(text)
    assert token.number == number and (token.start, token.end) == (0, len(text))


@pytest.mark.parametrize(
    ("prompt", "degrees", "side"),
    [
        ("turns thirty degrees to the left", 30, "left"),
        ("half a turn to the right", 180, "right"),
        ("a quarter to the right", 90, "right"),
        ("about turn!", 180, ""),
        ("he turns by a right angle to his left", 90, "left"),
        ("turn to your three o'clock", 90, "right"),
        ("she swivels to ten o'clock", 60, "left"),
        ("spin round one and a half times", 540, ""),
        ("two complete revolutions", 720, ""),
    ],
)
def test_turns_in_words(prompt: str, degrees: float, side: str) -> None:
    (claim,) = request_of(prompt).claims
    assert (claim.kind, claim.degrees * max(claim.count, 1), claim.side) == ("turn", degrees, side)


def test_contractions_and_marks() -> None:
    words = [token.text for token in tokens_of("He doesn't; can’t kick 90° or 2-3 times!")]
    assert words == ["he", "does", "not", ";", "can", "not", "kick", "90", "°", "or", "2", "-",
                     "3", "times", "!"]  # fmt: skip
    assert plain("He (slowly) walks!") == "he slowly walks"


@pytest.mark.parametrize(
    ("pattern", "text", "end"),
    [
        ("~pick up", "picks up a ball", 2),
        ("~pick * up", "picking the red ball up", 5),
        ("~pick * up", "picks, up", None),
        ("~turn & left|right", "turned left", 1),
        ("~turn a? {number}", "turn 3", 2),
        ("do {angle} {stop}", "do 180 pose", None),
        ("do {angle} {stop}", "do 180.", 2),
    ],
)
def test_patterns(pattern: str, text: str, end: int | None) -> None:
    assert match(pattern, tokens_of(text), 0) == end


def test_forms_of_verbs() -> None:
    assert forms("run") == {"ran": "past", "running": "participle", "runs": "third", "run": "base"}
    assert {"jogged", "jogging"} <= forms("jog").keys() and "swivelled" in forms("swivel")


def test_digits_that_are_no_numbers_are_passed_over() -> None:
    assert [token.number for token in tokens_of("① walk 45² times")] == [0, 0, 45, 0, 0]
    assert words_of("He's 2 m tall") == ["he's", "m", "tall"]


def test_words_are_replaced_as_words() -> None:
    assert (
        with_words("Walk a walkk, WALKK İ walkk", {"walkk": "walk"}) == "Walk a walk, walk İ walk"
    )


@pytest.mark.parametrize(
    ("sentence", "without"),
    [
        ("six slow calf raises", "slow calf raises"),
        ("clap three times over your head", "clap over your head"),
        ("turn around 180 degrees", "turn around 180 degrees"),
        ("balance on one leg", "balance on one leg"),
        ("twice", "twice"),
    ],
)
def test_a_sentence_without_its_counts(sentence: str, without: str) -> None:
    assert uncounted(sentence) == without


_VERBS = "do stand pick take throw duck answer raise move wait lean climb change walk wave"
_VOCABULARY = {
    *_VERBS.split(),
    *(inflect(verb, "participle") for verb in _VERBS.split()),
    *("man", "stone", "squats", "jump", "umbrella", "cup", "leg"),
}


@pytest.mark.parametrize(
    ("sentence", "clauses"),
    [
        ("do three push-ups and stand up", ["do three push-ups", "stand up"]),
        (
            "A man picks up a stone, takes two steps, and then quickly throws it.",
            ["A man picks up a stone", "takes two steps", "quickly throws it."],
        ),
        ("two squats followed by a jump", ["two squats", "a jump"]),
        ("he ducks and answers with a hook", ["he ducks", "answers with a hook"]),
        ("raises the left arm and the right leg", None),
        ("moves the arms up and down", None),
        ("stands waiting, leaning on one leg", None),
        ("climbing a ladder and changing a bulb", ["climbing a ladder", "changing a bulb"]),
        ("walks forward, waving", None),
        ("picks up a cup and umbrellas", None),
        ("", None),
    ],
)
def test_clauses_have_verbs_of_their_own(sentence: str, clauses: list[str] | None) -> None:
    assert clauses_of(sentence, _VOCABULARY.__contains__) == (clauses or [sentence])


@pytest.mark.parametrize(
    ("sentence", "pair"),
    [
        ("strolls while eating an ice cream", ("strolls", "eating an ice cream")),
        ("hums while strolling", ("strolling", "hums")),
        ("runs with the arms up", ("runs", "the arms up")),
        ("walks on, nodding", ("walks on", "nodding")),
        ("goes forward juggling", ("goes forward", "juggling")),
        ("walks as she claps", ("walks", "she claps")),
    ],
)
def test_movements_at_once_are_taken_apart(sentence: str, pair: tuple[str, str]) -> None:
    assert pair in at_once(sentence)


@pytest.mark.parametrize("sentence", ["walks to the building", "is walking", "jumps as if hurt"])
def test_one_movement_is_not_taken_apart(sentence: str) -> None:
    assert at_once(sentence) == []
