"""Patterns of prompts as users type them, words for counts, and prompts that never vary.

`prompting` expands a pattern: `[a|b|]` is one of the alternatives, `~turn` is a verb in the form
of the sentence, `<his>`, `<him>`, `<he>` and `<is>` agree with the subject, `<the>` is "the" or
"his". The plainest patterns come first and are drawn most often.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType

from latentmotion.measure.facts import LEFT

_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

GOING = {"walk": "walking", "jog": "jogging", "run": "running"}
"""Participles of gaits."""

ONCE = "[|||once|once|once|one time|just once]"
"""A single repetition, left out half of the time."""

ONE = "[a|a|a|one|a single|just one]"
"""The article or number of a single thing."""

IN_A_ROW = "[|||| in a row]"
"""Words that may follow a counted noun."""

PEOPLE_ON_FOOT = ("a pedestrian", "a passerby", "our hero")

RUNNERS = ("a runner", "the runner", "an athlete", "a jogger")

FIGHTERS = ("a fighter", "a boxer", "the boxer", "a martial artist")

KICKERS = ("a fighter", "a kickboxer", "a martial artist", "a soccer player")

ATHLETES = ("an athlete", "a gymnast", "a man at the gym")


@dataclass(frozen=True)
class Wording:
    """Patterns for one action."""

    clauses: Sequence[str]
    """Verb phrases without a subject."""
    nouns: Sequence[str] = ()
    """Noun phrases."""
    after: Sequence[str] = ()
    """Verb phrases that fit only after another action, such as "walk away"."""
    people: Sequence[str] = ()
    """Subjects that fit this action best."""
    places: Sequence[str] = ()
    """Harmless contexts to put at the end."""
    orders: Sequence[str] = ()
    """Whole prompts without a verb to inflect."""


def patterns(text: str) -> list[str]:
    """Returns the patterns of a block of text, which are separated by semicolons."""
    return [" ".join(pattern.split()) for pattern in text.split(";")]


def people_on_foot(gait: str) -> Sequence[str]:
    """Returns subjects that fit a gait."""
    return RUNNERS if gait in ("jog", "run") else PEOPLE_ON_FOOT


def number(count: int) -> str:
    """Returns a number in letters or digits."""
    return f"[{_NUMBERS[count]}|{_NUMBERS[count]}|{count}]" if count < len(_NUMBERS) else str(count)


def times(count: int) -> str:
    """Returns how often: "twice", "three times"; "once" is left out half of the time."""
    if count == 1:
        return ONCE
    if count == 2:
        return "[twice|twice|twice|two times|2 times|twice in a row|a couple of times]"
    vague = "|several times" if count >= 4 else "|a few times"
    vague += "|again and again|repeatedly|over and over" if count >= 5 else ""
    return f"[{number(count)} times|{number(count)} times|{number(count)} times in a row{vague}]"


def some(count: int, one: str, many: str) -> str:
    """Returns a counted noun: "a kick", "one kick", "two kicks", "several kicks"."""
    if count == 1:
        return f"{ONE} {one}"
    vague = "|a couple of" if count == 2 else "|several" if count >= 4 else "|a few"
    return f"[{number(count)}|{number(count)}|{number(count)}{vague}] {many}{IN_A_ROW}"


def towards(side: str) -> str:
    """Returns the direction of a turn or a step to a side."""
    return f"[{side}|to the {side}|{side}|to the {side}|to <his> {side}]"


def clockwise(side: str) -> str:
    """Returns the sense of rotation, seen from above, of a turn to a side."""
    if side == LEFT:
        return "[counterclockwise|counterclockwise|counter-clockwise|anticlockwise]"
    return "clockwise"


@cache
def fixed_wordings() -> Mapping[str, Wording]:
    """Returns the patterns of postures and changes of gait, which have no side and no count."""
    table = tomllib.loads(
        files("latentmotion.training.captioning")
        .joinpath("postures.toml")
        .read_text(encoding="utf-8")
    )
    lists = table.pop("lists")

    def filled(text: str) -> list[str]:
        for name, words in lists.items():
            text = text.replace(f"{{{name}}}", words)
        return patterns(text)

    return MappingProxyType(
        {
            kind: Wording(**{name: filled(text) for name, text in rows.items()})
            for kind, rows in table.items()
        }
    )
