"""Instructions and their checks; the fixed ones are a test set that no model is trained on.

The checks are those by which trainings judge: `latentmotion.evaluation.instructions` measures by
others.

A check is a small expression, e.g. `kick(right, 2)` or `turn(left, 60, 120)`:

    check = term & term & …     every term holds
          | term > term > …     the acts happen in this order
    term  = name | name(word or number, …)

A name is that of an act (`checking.py`), with words that say which and numbers that say how often,
or of a condition. One number is an exact count, two are a range, and none is once
or more.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from zlib import crc32

import numpy as np

from latentmotion.data.clip import mirror_words
from latentmotion.errors import InputError
from latentmotion.language.words import plain
from latentmotion.storage.reading import read_table

SIDES = ("left", "right", "both", "any")
DIRECTIONS = ("forward", "backward", "left", "right")
TURNS = ("left", "right", "either")

_TERM = re.compile(r"([a-z_]+)(?:\(([^()]*)\))?")
_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass(frozen=True)
class Term:
    """One requirement."""

    name: str  # Name of an act or of a condition.
    words: tuple[str, ...] = ()  # Arguments that are words, e.g. a side.
    numbers: tuple[float, ...] = ()  # Arguments that are numbers.

    def __str__(self) -> str:
        arguments = [*self.words, *(f"{number:g}" for number in self.numbers)]
        return f"{self.name}({', '.join(arguments)})" if arguments else self.name

    @property
    def often(self) -> tuple[float, float]:
        """Least and greatest number of repetitions."""
        if not self.numbers:
            return 1, float("inf")
        return self.numbers[0], self.numbers[-1]


@dataclass(frozen=True)
class Check:
    """Requirements that a motion must meet to fulfill an instruction."""

    terms: tuple[Term, ...]  # The requirements.
    ordered: bool = False  # Whether they are acts in this order.

    def __str__(self) -> str:
        return (" > " if self.ordered else " & ").join(map(str, self.terms))


def parse(text: str) -> Check:
    """Reads an expression.

    Raises:
        InputError: It is not well formed.
    """
    ordered = ">" in text
    if ordered and "&" in text:
        raise InputError(f"check {text!r}: expected terms joined by & or by >, not both")
    terms = []
    for term in map(str.strip, text.split(">" if ordered else "&")):
        match = _TERM.fullmatch(term)
        if match is None:
            raise InputError(f"check {term!r}: expected a term such as kick(right, 2)")
        arguments = [part.strip() for part in (match[2] or "").split(",") if part.strip()]
        words = tuple(part for part in arguments if not _NUMBER.fullmatch(part))
        numbers = arguments[len(words) :]
        if [*words, *numbers] != arguments:
            raise InputError(f"check {term!r}: expected words before numbers")
        terms.append(Term(match[1], words, tuple(map(float, numbers))))
    return Check(tuple(terms), ordered)


# Groups of instructions in the order of reports.
GROUPS = ("side", "turns", "counts", "order", "pace", "posture", "direction", "action")


@dataclass(frozen=True)
class Instruction:
    """A sentence, and the check of motions that follow it."""

    id: str  # Unique name, e.g. `side-01`.
    group: str  # Its group.
    prompt: str  # The sentence, as a user would type it.
    check: Check  # The requirements.
    seconds: float | None = None  # Length of the motion; by default the model's own choice.

    def seeds(self, takes: int) -> list[int]:
        """Returns one seed per take; no two in the list are equal."""
        sequences = (np.random.SeedSequence([crc32(self.id.encode()), n]) for n in range(takes))
        return [int(sequence.generate_state(1)[0]) for sequence in sequences]


@cache
def refused_captions() -> frozenset[str]:
    """Returns the sentences and their mirror images as plain text, which no caption may equal."""
    sentences = [instruction.prompt for instruction in instructions()]
    return frozenset(
        plain(text) for sentence in sentences for text in (sentence, mirror_words(sentence))
    )


@cache
def instructions() -> tuple[Instruction, ...]:
    """Returns the list."""
    return tuple(
        Instruction(
            id=row["id"],
            group=row["group"],
            prompt=row["prompt"],
            check=parse(row["check"]),
            seconds=float(row["seconds"]) if row["seconds"] else None,
        )
        for _, row in read_table(Path(__file__).with_name("instructions.csv"), ())
    )
