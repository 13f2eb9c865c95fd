"""Words and patterns of captions, from `captions.toml`, and verbs by their forms."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from importlib.resources import files

from latentmotion.language.inflection import present_participle, third_person

TABLE = tomllib.loads(
    files("latentmotion.training.captioning").joinpath("captions.toml").read_text("utf-8")
)
"""Lists of words by name, `patterns`, groups of verbs and phrases."""

VERBS = tuple(TABLE["verbs"].split())
"""Base forms."""

BASE_OF_THIRD = {third_person(verb): verb for verb in VERBS}
"""Base form by third person."""

BASE_OF_PARTICIPLE = {present_participle(verb): verb for verb in VERBS}
"""Base form by participle."""


@dataclass(frozen=True)
class VerbGroup:
    """Beginnings of clauses, verb first in its base form, that mean the same."""

    phrases: tuple[str, ...]
    """The beginnings; the first found that fits is replaced by another."""
    following: str = ""
    """Pattern of what must follow."""
    unless: str = ""
    """Pattern that must not be anywhere in the clause."""


def word_set(name: str) -> frozenset[str]:
    """Returns a list of words of the table."""
    return frozenset(TABLE[name].split())


def _pattern(text: str) -> str:
    """Puts the patterns of the table in the place of their names; braces may also be counts."""
    return re.sub(r"\{([a-z]+)\}", lambda match: TABLE["patterns"][match[1]], text)


VERB_GROUPS = tuple(
    VerbGroup(tuple(row["phrases"]), _pattern(row.get("following", "")), row.get("unless", ""))
    for row in TABLE["group"]
)
"""Beginnings of clauses that mean the same."""

PHRASES = tuple((row["pattern"], tuple(row["choices"])) for row in TABLE["phrase"])
"""Patterns inside a clause, verb first in its base form, and what each may become."""

_NUMBERS = ("two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

_COUNTED = re.compile(
    rf"\b({'|'.join(_NUMBERS)}|[2-9]|10) (?=(?:small |big |large |slow |quick )?"
    r"(?:steps|times|jumps|hops|kicks|punches|squats|paces|laps|circles)\b)"
)


def other_number(text: str) -> str:
    """Writes counts of steps and repetitions in digits where they were words, and back."""

    def swap(match: re.Match[str]) -> str:
        word = match.group(1)
        number = str(_NUMBERS.index(word) + 2) if word in _NUMBERS else _NUMBERS[int(word) - 2]
        return f"{number} "

    return _COUNTED.sub(swap, text)
