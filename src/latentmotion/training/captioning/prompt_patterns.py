"""Single actions → patterns of the prompts that ask for them, from `prompts.toml`.

`prompting` expands a pattern: `[a|b|]` is one of the alternatives, `~turn` is a verb in the form of
the sentence, `<his>`, `<him>`, `<he>` and `<is>` agree with the subject, `<the>` is "the" or
"his". The plainest patterns come first and are drawn most often.
"""

from __future__ import annotations

import operator
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from importlib.resources import files
from typing import Any

from latentmotion.measure.facts import LEFT, SingleAction

_NUMBERS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

GOING = {"walk": "walking", "jog": "jogging", "run": "running"}
"""Participles of gaits."""

ONCE = "[|||once|once|once|one time|just once]"
"""A single repetition, left out half of the time."""

ONE = "[a|a|a|one|a single|just one]"
"""The article or number of a single thing."""

IN_A_ROW = "[|||| in a row]"
"""Words that may follow a counted noun."""

# Tables of kinds of actions that are named otherwise.
_TABLES = {
    **dict.fromkeys(GOING, "gait"),
    **dict.fromkeys(("start_walking", "start_running"), "start"),
    **dict.fromkeys(("stop_walking", "stop_running"), "stop"),
    **dict.fromkeys(("turn", "walk_then_turn", "turn_then_walk"), "turned"),
}

_COMPARED = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
    "is": lambda value, names: value in names, "not": lambda value, names: value not in names,
}  # fmt: skip


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


_LISTS = tuple(field.name for field in fields(Wording))


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


def clockwise(side: str) -> str:
    """Returns the sense of rotation, seen from above, of a turn to a side."""
    if side == LEFT:
        return "[counterclockwise|counterclockwise|counter-clockwise|anticlockwise]"
    return "clockwise"


@cache
def _tables() -> Mapping[str, Any]:
    text = files("latentmotion.training.captioning").joinpath("prompts.toml").read_text("utf-8")
    return tomllib.loads(text)


def kinds() -> tuple[str, ...]:
    """Returns all kinds of actions that have words."""
    composed = {"words", "turned_off", "curved", *_TABLES.values()}
    return (*_TABLES, "turn_and_return", *(kind for kind in _tables() if kind not in composed))


def wording(action: SingleAction) -> Wording:
    """Returns the patterns for an action.

    Raises:
        KeyError: Its kind is none of `kinds`.
    """
    if action.kind == "turn":
        return _turn(action)
    if action.kind in ("walk_then_turn", "turn_then_walk"):
        return _walk_and_turn(action)
    return _patterns(_TABLES.get(action.kind, action.kind), action)


def _turn(action: SingleAction) -> Wording:
    """Patterns for a turn on the spot, or on the way while walking or running."""
    gait, turned = action.gait, _patterns("turned", action)
    if gait and action.degrees > 270:
        return wording(replace(action, kind="circle"))
    if gait:
        on_the_way, going = _patterns("curved", action), GOING[gait]
        clauses = [f"~{gait} and {text}" for text in turned.clauses]
        clauses += [f"{text} while {going}" for text in turned.clauses[:5]]
        nouns = [f"{text} while {going}" for text in turned.nouns]
        return Wording([*clauses, *on_the_way.clauses], nouns, people=on_the_way.people)
    if action.degrees >= 290:  # a spin, in whose words there is no going elsewhere
        return turned
    clauses = [f"{text}[||||| on the spot| in place]" for text in turned.clauses]
    clauses += [f"~stand on the spot and {text}" for text in clauses[:1]]
    return replace(turned, clauses=clauses)


def _walk_and_turn(action: SingleAction) -> Wording:
    """Patterns for a straight way and then a turn, or the other way around."""
    gait = action.gait or "walk"
    turned, turned_off = _patterns("turned", action), _patterns("turned_off", action)
    turns, nouns = [*turned.clauses, *turned_off.clauses], [*turned.nouns, *turned_off.nouns]
    if action.kind == "walk_then_turn":
        way = f"~{gait} [||forward|ahead|straight ahead|a bit|a little]"
        clauses = [f"{way}[, then|, then| and then| and|, and then] {text}" for text in turns]
        named = [f"a {gait} [forward|], then {text}" for text in nouns]
        return Wording(clauses, [*named, *(f"a {gait} followed by {text}" for text in nouns)])
    on = f"~{gait} [||forward|off|away|on|straight on|ahead|straight ahead]"
    clauses = [f"{text}[, then| and then| and| and|, and then] {on}" for text in turns]
    named = [f"{text}, then a {gait} [forward|straight ahead|]" for text in nouns]
    return Wording(clauses, [*named, *(f"{text} followed by a {gait}" for text in nouns)])


def _patterns(table: str, action: SingleAction) -> Wording:
    """Returns the lists of those parts of a table that hold for an action."""
    words = _properties(action) | _tables()["words"]
    parts = list(filled(_tables()[table], words, _LISTS))
    return Wording(**{name: [text for part in parts for text in part[name]] for name in _LISTS})


def filled(
    parts: Sequence[Mapping[str, Any]], properties: Mapping[str, Any], lists: Sequence[str]
) -> Iterator[dict[str, list[str]]]:
    """Yields the lists of patterns of those parts of a table that hold.

    Args:
        parts: The parts, each with a `when`, lists of patterns, and texts that all parts may name.
        properties: What conditions and patterns may name.
        lists: Names of the lists.
    """
    words = dict(properties)
    for part in parts:
        words |= {name: text for name, text in part.items() if name not in (*lists, "when")}
    for part in parts:
        if _holds(part.get("when", ""), words):
            texts = {name: _filled(" ".join(part.get(name, "").split()), words) for name in lists}
            yield {
                name: [" ".join(pattern.split()) for pattern in text.split(";") if pattern]
                for name, text in texts.items()
            }


def _properties(action: SingleAction) -> dict[str, Any]:
    """Returns what patterns and conditions may name of an action."""
    kind, pace, side, degrees = action.kind, action.pace or "normal", action.side, action.degrees
    go = action.gait or (kind if kind in GOING else "run" if kind.endswith("running") else "walk")
    if kind == "jog" and pace != "normal":  # a fast jog is a run, and a slow one a slow run
        tempo = "run-slow" if pace == "slow" else "run-normal"
    else:
        tempo = f"{go}-{pace}"
    rounds = round(degrees / 360)
    spins = "several times" if rounds > 2 else "more than once"
    if rounds > 1 and abs(degrees / 360 - rounds) < 0.2:
        spins = times(rounds)
    return {
        "kind": kind, "side": side, "direction": action.direction, "count": action.count,
        "degrees": degrees, "gait": action.gait, "pace": action.pace, "frames": action.frames,
        "act": action.act[1] - action.act[0], "go": go, "going": GOING[go], "tempo": tempo,
        "often": times(action.count), "number": number(action.count), "spins": spins,
        "to": f"[{side}|to the {side}|{side}|to the {side}|to <his> {side}]",
        "clock": clockwise(side),
    }  # fmt: skip


def _holds(condition: str, words: Mapping[str, Any]) -> bool:
    """Says whether a condition holds, such as "33 <= degrees < 60 and side is left|right"."""

    def value(word: str) -> Any:
        return words[word] if word in words else float(word)

    for alternative in condition.split(" or "):
        for comparison in filter(None, alternative.split(" and ")):
            terms = comparison.split()
            if terms[1] in ("is", "not"):
                name = str(words[terms[0]] or "none")
                holds = _COMPARED[terms[1]](name, terms[2].split("|"))
            else:
                triples = zip(terms[::2], terms[1::2], terms[2::2], strict=False)
                holds = all(_COMPARED[how](value(a), value(b)) for a, how, b in triples)
            if not holds:
                break
        else:
            return True
    return False


def _filled(text: str, words: Mapping[str, Any]) -> str:
    """Fills in the names in braces, the innermost first."""

    def fill(match: re.Match[str]) -> str:
        how, _, nouns = match[1].partition(" ")
        if nouns:
            counted = some(words["count"], *nouns.split(" / "))
            return counted if how == "some" else counted.removesuffix(IN_A_ROW)
        chosen = words[how]
        if isinstance(chosen, dict):
            by = str(words[chosen["by"]] or "none")
            texts = {word: text for names, text in chosen.items() for word in names.split("|")}
            chosen = texts.get(by, chosen.get("other"))
        return str(chosen)

    while "{" in text:
        text = re.sub(r"\{([^{}]*)\}", fill, text)
    return text
