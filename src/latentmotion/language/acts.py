"""The acts that sentences name, from `acts.toml`, and where a sentence names them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from latentmotion.language.inflection import forms
from latentmotion.language.tables import data
from latentmotion.language.words import Token, beginnings, match


@dataclass(frozen=True)
class ActWords:
    """An entry of the table."""

    kind: str
    """Kind of the claim; empty where the words ask for nothing."""
    caption: str
    """Kind of the claim of a caption; empty where its check measures nothing of it."""
    words: tuple[str, ...] = ()
    """Verbs in their base form."""
    nouns: tuple[str, ...] = ()
    """Base forms of those that name the act as nouns, too."""
    things: tuple[str, ...] = ()
    """Base forms of nouns that mostly name something else."""
    phrases: tuple[str, ...] = ()
    """Patterns of several words."""
    unless: tuple[str, ...] = ()
    """Patterns that must not follow."""
    passive: bool = False
    """Whether somebody else may do it to the person."""
    begins: bool = False
    """Whether its phrases stand at the beginning of a clause."""
    slight: bool = False
    """Whether the words imply a slight turn."""
    pace: str = ""
    """Pace that the words imply."""


@dataclass(frozen=True)
class Mention:
    """A place where a sentence names an act."""

    act: ActWords
    """The act."""
    start: int
    """First token."""
    end: int
    """One past the last token."""
    form: str = ""
    """Form of the verb, as `inflection.forms` names it; `noun`; empty for a phrase."""
    base: str = ""
    """Base form of the verb; empty for a phrase."""


@cache
def acts() -> tuple[ActWords, ...]:
    """Returns the table."""
    return tuple(map(_act, data("acts.toml")["act"]))


def _act(row: Mapping[str, Any]) -> ActWords:
    values: dict[str, Any] = {"caption": row["kind"], **row}
    lists: dict[str, Any] = {
        name: tuple(value) for name, value in values.items() if isinstance(value, list)
    }
    return ActWords(**(values | lists))


@cache
def _verbs() -> Mapping[str, tuple[ActWords, str, str]]:
    """Returns act, form and base form by the forms of single words."""
    found: dict[str, tuple[ActWords, str, str]] = {}
    for act in acts():
        for base in dict.fromkeys((*act.words, *act.nouns, *act.things)):
            for form, name in forms(base).items():
                if base not in act.words:
                    name = {"base": "noun", "third": "nouns"}.get(name, "")
                if name:
                    found.setdefault(form, (act, name, base))
    return found


@cache
def _phrases() -> Mapping[str, tuple[tuple[ActWords, str], ...]]:
    """Returns acts with a phrase, by the words that it may begin with."""
    found: dict[str, list[tuple[ActWords, str]]] = defaultdict(list)
    for act in acts():
        for phrase in act.phrases:
            for word in beginnings(phrase):
                found[word].append((act, phrase))
    return {word: tuple(rows) for word, rows in found.items()}


def mentions(tokens: Sequence[Token]) -> list[Mention]:
    """Returns where acts are named, in order; where two begin at one word the longer one."""
    found: list[Mention] = []
    at = 0
    while at < len(tokens):
        here: list[Mention] = []
        for act, phrase in _phrases().get(tokens[at].text, ()):
            end = match(phrase, tokens, at)
            if end is not None and end > at:
                here.append(Mention(act, at, end))
        if tokens[at].text in _verbs():
            act, form, base = _verbs()[tokens[at].text]
            here.append(Mention(act, at, at + 1, form, base))
        here = [
            one
            for one in here
            if not any(match(word, tokens, one.end) is not None for word in one.act.unless)
        ]
        best = max(here, key=lambda one: one.end, default=None)
        if best is None:
            at += 1
            continue
        found.append(best)
        at = best.end
    return [one for one in found if one.act.kind]
