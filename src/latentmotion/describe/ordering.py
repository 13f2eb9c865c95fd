"""One action and then another in one sentence, in the ways in which people write it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from latentmotion.describe.clauses import Sentence
from latentmotion.describe.rewording import predicate, reworded

_ACTORS: dict[str, tuple[tuple[str, str], ...]] = {
    "neutral": (
        ("a person", "the person"),
        ("someone", "the person"),
        ("the figure", "the figure"),
    ),
    "male": (("a man", "he"), ("the man", "he")),
    "female": (("a woman", "she"), ("the woman", "she")),
}
"""Subjects, and how a second sentence calls them."""

_FRAMES = (
    (("going", "goes"), "after {one}, {subject} {other}"),
    (("goes", "going"), "{subject} {one} before {other}"),
    (("go", "go"), "first {one}, then {other}"),
    (("goes", "goes"), "{subject} first {one}, then {other}"),
    (("goes", "goes"), "{subject} {one}. then {again} {other}."),
    (("goes", "goes"), "{subject} {one} and after that {other}"),
    (("go", "go"), "{one} and afterwards {other}"),
)
"""Forms of the verbs of both parts, and what is written around them."""


def in_order(
    first: Sentence, second: Sentence, generator: np.random.Generator, count: int
) -> list[str]:
    """Returns sentences that tell of one action and then of another.

    Args:
        first: What happens first.
        second: What happens next, by the same person.
        generator: Source of every choice.
        count: How many are wanted.

    Returns:
        Different sentences: "a person walks forward, then sits down.", "walk forward, sit down",
        "after walking forward, a person sits down", "first walk forward, then sit down" and the
        like; fewer than `count` where there are no more.
    """
    joined = together(first, second)
    found: dict[str, None] = {}
    for _ in range(6 * count):
        if len(found) == count:
            break
        framed = not joined.referring and generator.random() < 0.4
        found.setdefault(
            _framed(first, second, generator) if framed else reworded(joined, generator)
        )
    return [text for text in found if text]


def together(first: Sentence, second: Sentence) -> Sentence:
    """Returns both as one sentence with the first's subject."""
    then = replace(second.clauses[0], link="then")
    clauses = (*first.clauses, then, *second.clauses[1:])
    gender = first.gender if first.gender == second.gender else "neutral"
    return Sentence(first.subject, gender, clauses, first.referring or second.referring)


def _framed(first: Sentence, second: Sentence, generator: np.random.Generator) -> str:
    """Writes "after …ing", "before …ing", "first …, then …" or two sentences."""
    gender = str(generator.choice(["neutral", "neutral", "male", "female"]))
    subject, again = _ACTORS[gender][int(generator.integers(len(_ACTORS[gender])))]
    forms, text = _FRAMES[int(generator.integers(len(_FRAMES)))]
    owner = "you" if "go" in forms else gender
    parts = zip((first, second), forms, strict=True)
    one, other = (predicate(part, form, owner, generator) for part, form in parts)
    return text.format(subject=subject, again=again, one=one, other=other)
