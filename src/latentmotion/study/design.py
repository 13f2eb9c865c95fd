"""A study: which motion stands on which side, in which order; and the key that says so.

Sides are balanced (each model is on the left in half of the pairs, or one more) and shuffled, and
so is the order. The page knows pairs by opaque names alone; the key is a file of its own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from latentmotion.errors import InputError
from latentmotion.motion import Motion

Model = Literal["A", "B"]

QUESTIONS = {
    "realism": "Which motion is more realistic?",
    "text": "Which motion fits the text better?",
}
"""What raters are asked, by name; the second only where there is a text."""


@dataclass(frozen=True)
class KeyPair:
    """One pair, as the key knows it."""

    id: str
    """Its opaque name."""
    prompt: str
    """The sentence."""
    seed: int
    """Seed of both motions, or the number of the take."""
    left: Model
    """Whose motion stands on the left."""


@dataclass(frozen=True)
class StudyKey:
    """What raters must not know: `study.key.json`."""

    format: str
    """Which version of the format this is."""
    study: str
    """Name of the study, which its answers carry."""
    a: str
    """What A is."""
    b: str
    """What B is."""
    seed: int
    """Seed of order and sides."""
    questions: dict[str, str]
    """What is asked."""
    pairs: tuple[KeyPair, ...]
    """All pairs, in the order of the page."""


KEY_FORMAT = "latentmotion study key 1"


@dataclass(frozen=True, eq=False)
class Pair:
    """Two motions for one sentence."""

    prompt: str
    """The sentence; empty for motion without words."""
    seed: int
    """Seed of both, or the number of the take."""
    a: Motion
    """What A made of it."""
    b: Motion
    """What B made of it."""


@dataclass(frozen=True, eq=False)
class Study:
    """A study, ready to be written."""

    key: StudyKey
    """What raters must not know."""
    motions: tuple[tuple[Motion, Motion], ...]
    """Left and right of each pair, in the order of the key."""


def design(pairs: Sequence[Pair], a: str, b: str, seed: int) -> Study:
    """Shuffles pairs and sides.

    Args:
        pairs: What is compared.
        a: What A is, for the key.
        b: What B is, for the key.
        seed: Seed of order, sides and names.

    Raises:
        InputError: There is no pair.
    """
    if not pairs:
        raise InputError("no pair to show; give at least one sentence")
    generator = np.random.default_rng(seed)
    order = generator.permutation(len(pairs))
    a_left = generator.permutation(np.arange(len(pairs)) % 2 == 0)
    names = [generator.bytes(6).hex() for _ in pairs]
    shown = [pairs[index] for index in order]
    rows = [
        KeyPair(name, pair.prompt, pair.seed, "A" if left else "B")
        for name, pair, left in zip(names, shown, a_left, strict=True)
    ]
    questions = {k: v for k, v in QUESTIONS.items() if k != "text" or any(p.prompt for p in pairs)}
    key = StudyKey(KEY_FORMAT, _name(rows, shown), a, b, seed, questions, tuple(rows))
    sides = [
        (p.a, p.b) if row.left == "A" else (p.b, p.a) for p, row in zip(shown, rows, strict=True)
    ]
    return Study(key, tuple(sides))


def asked(prompt: str, questions: Sequence[str]) -> list[str]:
    """Returns the names of the questions that a pair with this prompt gets."""
    return [name for name in questions if name != "text" or prompt]


def _name(rows: Sequence[KeyPair], pairs: Sequence[Pair]) -> str:
    """A hash of all that is shown, so that answers to anything else can be told."""
    digest = hashlib.sha256()
    for row, pair in zip(rows, pairs, strict=True):
        digest.update(f"{row.id} {row.prompt} {row.left}".encode())
        digest.update(pair.a.joints.tobytes() + pair.b.joints.tobytes())
    return digest.hexdigest()[:16]
