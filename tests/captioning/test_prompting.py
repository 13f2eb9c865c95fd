"""Prompts worded as users type them: grammar, sides, counts, order, and words in a mirror."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from latentmotion.data.clip import mirror_words
from latentmotion.language.reading import claims_of
from latentmotion.language.words import plain
from latentmotion.measure.facts import SingleAction
from latentmotion.training.captioning.prompting import kinds, prompts, prompts_in_order, wording

_GAITS = ("walk", "jog", "run")
_TURNING = ("walk_then_turn", "turn_then_walk", "turn_and_return", "circle", "half_circle")
_COUNTED = ("jump", "hop", "kick", "punch", "raise", "clap", "knee", "jack", "squat", "bow")
_SIDED = ("kick", "punch", "hop", "knee", "raise", "touch_head", "arm_circle", "turn")

_EXAMPLES: dict[str, dict[str, object]] = {
    **{kind: {"direction": "forward", "pace": "normal"} for kind in _GAITS},
    "steps": {"count": 3, "direction": "forward"},
    "turn": {"side": "left", "degrees": 90.0},
    **{kind: {"side": "left", "degrees": 180.0, "gait": "walk"} for kind in _TURNING},
    "weave": {"gait": "walk"},
    "speed_up": {"gait": "walk"},
    "slow_down": {"gait": "run"},
    "climb": {"direction": "up"},
    **{kind: {"side": "left"} for kind in ("pick_up", "balance", "touch_head", "wave")},
    **{kind: {"side": "left", "count": 2} for kind in ("hop", "kick", "punch", "raise", "knee")},
    "arm_circle": {"side": "left", "direction": "forward"},
    **{kind: {"count": 2} for kind in ("jump", "clap", "jack", "squat", "bow")},
}


def _example(kind: str, **changes: object) -> SingleAction:
    fields = {"side": "", **_EXAMPLES.get(kind, {}), **changes}
    return replace(SingleAction(kind, 0, 60), **fields)


def _generator(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@cache
def _many(kind: str, count: int = 80, **changes: object) -> list[str]:
    return prompts(_example(kind, **changes), _generator(), count)


def _well_formed(sentence: str) -> bool:
    strange = re.search(r"  |[\[\]|~<>{}]|WAY|LIMB|\b(\w+) \1\b| ,|,,|\.\.", sentence)
    return strange is None and sentence == sentence.strip() and len(sentence) > 2


def _agreement_is_right(sentence: str) -> bool:
    """Whether "they" has plural verbs, and everyone else those with s."""
    words = sentence.lower().rstrip(".").split()
    if words[0] != "they":
        return not re.match(
            r"(?:he|she|a person|someone) (?:turn|walk|kick|jump|are)\b", sentence.lower()
        )
    return words[1] not in ("is", "was", "does", "has", "goes") and not re.fullmatch(
        r"(?:walk|turn|kick|punch|raise|jump|wave|sit|stand|take|make|run|lift|spin)e?s", words[1]
    )


@pytest.mark.parametrize("kind", kinds())
def test_every_kind_has_many_prompts_that_are_well_formed(kind: str):
    found = _many(kind)
    assert len(found) >= 40
    assert len({plain(sentence) for sentence in found}) == len(found)
    assert [sentence for sentence in found if not _well_formed(sentence)] == []
    assert [sentence for sentence in found if not _agreement_is_right(sentence)] == []


@pytest.mark.parametrize("kind", kinds())
def test_words_in_a_mirror_tell_of_the_other_side(kind: str):
    for sentence in _many(kind):
        mirrored = mirror_words(sentence)
        assert mirror_words(mirrored).lower() == re.sub(
            r"(?:counter-|anti)clockwise", "counterclockwise", sentence.lower()
        )
        if kind not in ("weave", "knee", "punch") and re.search(r"\b(?:left|right)\b", sentence):
            assert mirrored != sentence


@pytest.mark.parametrize("kind", _SIDED)
def test_only_the_own_side_is_told(kind: str):
    found = " ".join(_many(kind, side="left"))
    assert re.search(r"\bleft\b|counterclockwise", found)
    assert not re.search(r"\bright\b|(?<!counter)(?<!counter-)(?<!anti)clockwise", found)


@pytest.mark.parametrize("kind", ["jump", "clap", "jack", "squat", "bow", "sit_down", "stand"])
def test_no_side_is_told_where_there_is_none(kind: str):
    assert not re.search(r"\b(?:left|right|clockwise)\b", " ".join(_many(kind)))


@pytest.mark.parametrize("kind", _COUNTED)
def test_counts_are_those_of_the_action(kind: str):
    three = r"\b(?:three|3|a few|several)\b"
    told = _many(kind, count=60)
    for count in (1, 3):
        found = prompts(_example(kind, count=count), _generator(1), 60)
        for sentence in found:
            claimed = {claim.count for claim in claims_of(sentence) if claim.count}
            assert claimed <= {count}, sentence
    assert told
    named = [sentence for sentence in found if re.search(three, sentence.lower())]
    assert len(named) > 0.55 * len(found)


def test_once_is_told_half_of_the_time():
    found = prompts(_example("kick", count=1), _generator(2), 200)
    told = [s for s in found if re.search(r"\b(?:once|one|single)\b", s)]
    assert 0.25 * len(found) < len(told) < 0.75 * len(found)


@pytest.mark.parametrize(
    ("degrees", "expected", "never"),
    [
        (25.0, "slight", r"quarter|90|around|full"),
        (45.0, "45", r"quarter|90|around|full"),
        (90.0, "quarter", r"slight|180|around|full|45"),
        (180.0, "half turn", r"slight|90|quarter|full|360"),
        (360.0, "360", r"slight|180|quarter|half"),
        (1080.0, "three times", r"slight|180|quarter|half|\b360"),
    ],
)
def test_turns_are_told_by_their_degrees(degrees: float, expected: str, never: str):
    found = " ".join(prompts(_example("turn", degrees=degrees), _generator(), 150))
    assert expected in found
    assert not re.search(never, found)


def test_paces_are_told_where_they_are_not_normal():
    fast = r"\b(?:fast|quick|quickly|brisk|briskly|hurr\w+|rush\w*|sprint\w*)\b"
    slow = r"\b(?:slow|slowly|stroll\w*|amble\w*)\b"
    for kind in ("walk", "run"):
        normal = " ".join(prompts(_example(kind), _generator(), 200))
        assert not re.search(f"{fast}|{slow}", normal)
    quick = prompts(_example("walk", pace="fast"), _generator(), 100)
    assert len([text for text in quick if re.search(fast, text.lower())]) > 80
    assert not re.search(slow, " ".join(quick))


def test_starts_and_stops_backward_are_not_told_as_forward():
    for kind in ("start_walking", "stop_walking", "stop_running"):
        found = " ".join(_many(kind, direction="backward"))
        assert "backward" in found
        assert not re.search(r"\b(?:forward|ahead|off|away)\b", found)


def test_orders_come_in_many_forms_and_in_the_right_order():
    first, second = _example("kick", side="left", count=1), _example("sit_down")
    found = prompts_in_order(first, second, _generator(), 400)
    assert len(found) == 400
    text = "\n".join(found).lower()
    for form in (r", then ", r" and then ", r"^first ", r"^before ", r" before ", r"^after ",
                 r" after ", r"followed by", r"\. then "):  # fmt: skip
        assert re.search(form, text, re.MULTILINE), form
    for sentence in text.splitlines():
        kick = re.search(r"kick(?!b)|swing", sentence)
        sit = re.search(r"\bsit|\bsat\b|seat|settl|lower", sentence)
        assert kick and sit and _well_formed(sentence), sentence
        turned_round = sentence.startswith("before ") or (
            " after " in sentence and not sentence.startswith("after ")
        )
        assert (kick.start() > sit.start()) == turned_round, sentence


def test_two_of_a_kind_are_named_once():
    left, right = (_example("kick", side=side, count=1) for side in ("left", "right"))
    found = prompts_in_order(left, right, _generator(), 60)
    assert any(re.search(r"with (?:the|your|their|his|her) left leg,? ", s) for s in found)
    assert any(len(re.findall("kick", sentence.lower())) == 1 for sentence in found)
    assert all(
        s.find("left") < s.find("right") for s in found if not re.search("(?i)before|after", s)
    )


def test_refused_prompts_are_never_returned():
    action = _example("sit_down")
    refused = frozenset({"sit down", "a person sits down"})
    found = {plain(sentence) for sentence in prompts(action, _generator(), 200, refused)}
    assert not found & refused
    assert plain("Sit down.") in {plain(s) for s in prompts(action, _generator(), 200)}


def test_prompts_are_short_and_repeatable():
    words = [
        len(sentence.split())
        for kind in kinds()
        for sentence in prompts(_example(kind), _generator(), 20)
    ]
    assert np.mean(np.array(words) < 6) > 0.4
    assert prompts(_example("walk"), _generator(), 80) == _many("walk")


def test_an_unknown_kind_is_no_kind():
    with pytest.raises(KeyError):
        wording(SingleAction("fly", 0, 20))
