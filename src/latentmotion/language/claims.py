"""Claims: acts that a sentence asks for or tells of, and the numbers that clean-up makes exact.

Kinds of acts, and what is known of each, are the table that measuring, language and captions share.
It is data (`acts.toml`, `[kinds]`), so that whether a jump can be counted is said in one place. No
sentence is read here. A mirrored motion swaps left and right in its sentences.

A diffusion model turns by about what is asked and does an act about as often. Language reads the
numbers out of the sentence, the pipeline hands them on beside the motion as `Corrections`, and
clean-up edits the motion by them. Nothing obeys metadata, which tell what was asked and, as `made`,
what was done.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

LEFT, RIGHT, BOTH = "left", "right", "both"

SLIGHT = 25.0  # Degrees of a turn that a sentence calls slight.


@dataclass(frozen=True)
class Claim:
    """One act that a sentence mentions."""

    kind: str  # As `Event.kind`, or `move` (any gait), `circle`, `stop`, `place` (on the spot).
    side: str = ""  # Side of a hand, foot or knee, or of a turn.
    direction: str = ""  # `forward`, `backward`, `left`, `right`, `side` (either), `up`, `place`.
    count: int = 0  # Number of repetitions; zero where the sentence has none.
    degrees: float = 0.0  # Degrees of a turn; zero where the sentence has none.
    pace: str = ""  # `slow` or `fast`; empty where the sentence has none.
    then: bool = False  # Whether it comes after the claim before it.


@dataclass(frozen=True)
class Request:
    """What a prompt asks for."""

    claims: tuple[Claim, ...]  # The acts, in the order of the prompt.
    in_turn: bool  # Whether the acts follow one another; otherwise "while" or the like joins them.


@dataclass(frozen=True)
class Turn:
    """A turn of the whole body that a sentence asks for."""

    degrees: float  # By how much.
    side: str = ""  # `left`, `right`, or nothing for either.


@dataclass(frozen=True)
class Count:
    """Number of repetitions of an act that a sentence asks for."""

    act: str  # A name of `COUNTED`, the acts whose repetitions are measured.
    side: str = ""  # `left`, `right` or `both`, or nothing for any.
    times: int = 1  # Number of times, 1 or more.

    @property
    def wanted(self) -> range:
        """Counts that are as asked: a step more may be the one that ends the walk."""
        return range(self.times, self.times + (2 if self.act == "step" else 1))


@dataclass(frozen=True)
class Corrections:
    """What clean-up makes exact in one motion; by default nothing."""

    turn: Turn | None = None  # The turn, if the sentence names the degrees of exactly one.
    count: Count | None = None  # The count, if the sentence says how often exactly one act is done.
    # Whether it is a whole motion as a model generated it, without much that is quick.
    sharpens: bool = False
    settles: bool = False  # Whether its timing is free, too.
    # Frames that it may have to get longer for rest, where nobody gave its length.
    longest: int = 0
    on_floor: bool = False  # Whether its sentence names nothing above the floor to stand on.

    def about(self) -> dict[str, Any]:
        """Returns what a motion's metadata say of the numbers in its sentence."""
        numbers = {"turn": self.turn, "count": self.count}
        return {name: asdict(each) for name, each in numbers.items() if each is not None}


NO_CORRECTIONS = Corrections()  # Of a motion that nobody asked for a number.


# Replacements of words; all spellings of counterclockwise become clockwise.
_OTHER_SIDE = {"left": "right", "right": "left", "clockwise": "counterclockwise"}

# Endings such as "leftward", "rights" and "left-handed" follow; "upright", "frightened" must not.
_SIDED = re.compile(
    r"\b(?:(left|right)(?=s?\b|wards?\b|most\b|ies\b|y\b)|((?:counter|anti)[- ]?)?clock-?wise\b)",
    re.IGNORECASE,
)


def mirror_words(text: str) -> str:
    """Swaps left and right, clockwise and counterclockwise, in a sentence."""

    def swap(match: re.Match[str]) -> str:
        word = match.group(0)
        other = _OTHER_SIDE.get(word.lower().replace("clock-wise", "clockwise"), "clockwise")
        return other.capitalize() if word[0].isupper() else other

    return _SIDED.sub(swap, text)


@cache
def kinds(trait: str) -> tuple[str, ...]:
    """Returns the kinds with a trait."""
    return tuple(
        kind for kind, row in data("acts.toml")["kinds"].items() if trait in row["traits"].split()
    )


@cache
def related(relation: str) -> Mapping[str, tuple[str, ...]]:
    """Returns the kinds that kinds are related to: `similar`, `shown_by` or `looks_like`."""
    table = {
        kind: row[relation] for kind, row in data("acts.toml")["kinds"].items() if relation in row
    }
    return MappingProxyType({kind: tuple(others.split()) for kind, others in table.items()})


@cache
def limits(name: str) -> Mapping[str, float]:
    """Returns a limit of kinds: `rise` or `plain`."""
    return MappingProxyType(
        {kind: row[name] for kind, row in data("acts.toml")["kinds"].items() if name in row}
    )


@cache
def data(name: str) -> dict[str, Any]:
    """Returns a table, by the name of its file."""
    return tomllib.loads(files("latentmotion.language").joinpath(name).read_text(encoding="utf-8"))
