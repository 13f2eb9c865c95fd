"""What an instruction demands, as a small expression: `kick(right, 2)`, `turn(left, 60, 120)`.

    check = term & term & …     every term holds
          | term > term > …     the acts happen in this order
    term  = name | name(word or number, …)

A name is an act (`acts.py`), whose words say which and whose numbers say how often, or a condition
(`conditions.py`). One number is that many, two are from the one to the other, none is once or more.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from latentmotion.errors import InputError

_TERM = re.compile(r"([a-z_]+)(?:\(([^()]*)\))?")


@dataclass(frozen=True)
class Term:
    """One demand."""

    name: str
    """Name of an act or of a condition."""
    words: tuple[str, ...] = ()
    """Its arguments that are words, e.g. a side."""
    numbers: tuple[float, ...] = ()
    """Its arguments that are numbers."""

    def __str__(self) -> str:
        given = [*self.words, *(f"{number:g}" for number in self.numbers)]
        return f"{self.name}({', '.join(given)})" if given else self.name

    @property
    def often(self) -> tuple[float, float]:
        """Least and greatest number of repetitions."""
        if not self.numbers:
            return 1, float("inf")
        return self.numbers[0], self.numbers[-1]


@dataclass(frozen=True)
class Check:
    """What a motion must do to fulfill an instruction."""

    terms: tuple[Term, ...]
    """The demands."""
    ordered: bool = False
    """Whether they are acts that follow each other."""

    def __str__(self) -> str:
        return (" > " if self.ordered else " & ").join(map(str, self.terms))


def parse(text: str) -> Check:
    """Reads an expression.

    Raises:
        InputError: It is none.
    """
    ordered = ">" in text
    if ordered and "&" in text:
        raise InputError(f"check {text!r}: expected terms joined by & or by >, not both")
    return Check(tuple(map(_term, text.split(">" if ordered else "&"))), ordered)


def _term(text: str) -> Term:
    match = _TERM.fullmatch(text.strip())
    if match is None:
        raise InputError(f"check {text.strip()!r}: expected a term such as kick(right, 2)")
    given = [part.strip() for part in (match[2] or "").split(",") if part.strip()]
    words = tuple(part for part in given if not _is_number(part))
    if [*words, *given[len(words) :]] != given:
        raise InputError(f"check {text.strip()!r}: expected words before numbers")
    return Term(match[1], words, tuple(float(part) for part in given[len(words) :]))


def _is_number(text: str) -> bool:
    return re.fullmatch(r"\d+(\.\d+)?", text) is not None
