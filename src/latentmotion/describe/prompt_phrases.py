"""How people type prompts: patterns of verb phrases and noun phrases, and words for counts.

A pattern is read by `prompting`: `[a|b|]` is one of them, `~turn` a verb in the form of the
sentence, `<his>`, `<him>`, `<he>` and `<is>` agree with the subject, `<the>` is "the" or "his".
The plainest patterns come first; they are drawn most.
"""

from __future__ import annotations

from dataclasses import dataclass

from latentmotion.describe.facts import LEFT

NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

GOING = {"walk": "walking", "jog": "jogging", "run": "running"}
"""Participles of gaits."""

ONCE = "[|||once|once|once|one time|just once]"
"""How a single time is told, half of the time not at all."""

ONE = "[a|a|a|one|a single|just one]"
"""How a single thing is told."""

IN_A_ROW = "[|||| in a row]"
"""What may follow a number of things."""

PEOPLE_ON_FOOT = ("a pedestrian", "a passerby", "our hero")

RUNNERS = ("a runner", "the runner", "an athlete", "a jogger")

FIGHTERS = ("a fighter", "a boxer", "the boxer", "a martial artist")

KICKERS = ("a fighter", "a kickboxer", "a martial artist", "a soccer player")

ATHLETES = ("an athlete", "a gymnast", "a man at the gym")


@dataclass(frozen=True)
class Wording:
    """Patterns for one action."""

    clauses: tuple[str, ...]
    """Verb phrases without a subject."""
    nouns: tuple[str, ...] = ()
    """Noun phrases."""
    after: tuple[str, ...] = ()
    """Verb phrases that fit only after another action, such as "walk away"."""
    people: tuple[str, ...] = ()
    """Subjects that fit this action best."""
    places: tuple[str, ...] = ()
    """Harmless contexts to put at the end."""
    orders: tuple[str, ...] = ()
    """Whole prompts without a verb to inflect."""


def number(count: int) -> str:
    """Returns a number in letters or digits."""
    return f"[{NUMBERS[count]}|{NUMBERS[count]}|{count}]" if count < len(NUMBERS) else str(count)


def times(count: int) -> str:
    """Returns how often, nothing half of the time for once."""
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
    """Returns the way of a turn or a step to a side."""
    return f"[{side}|to the {side}|{side}|to the {side}|to <his> {side}]"


def clockwise(side: str) -> str:
    """Returns the sense of rotation seen from above."""
    if side == LEFT:
        return "[counterclockwise|counterclockwise|counter-clockwise|anticlockwise]"
    return "clockwise"
