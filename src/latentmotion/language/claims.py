"""Claims of a sentence: acts that it asks for or tells of, and what a prompt asks in all.

Left and right in a sentence, which a mirrored motion swaps.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

LEFT, RIGHT, BOTH = "left", "right", "both"

SLIGHT = 25.0
"""Degrees of a turn that a sentence calls slight."""


@dataclass(frozen=True)
class Claim:
    """One act that a sentence mentions."""

    kind: str
    """As `Event.kind`, or `move` (any gait), `circle`, `stop`, `place` (on the spot)."""
    side: str = ""
    """Side of a hand, foot or knee, or of a turn."""
    direction: str = ""
    """`forward`, `backward`, `left`, `right`, `side` (either), `up`, `place`."""
    count: int = 0
    """Number of repetitions; zero where the sentence has none."""
    degrees: float = 0.0
    """Degrees of a turn; zero where the sentence has none."""
    pace: str = ""
    """`slow` or `fast`; empty where the sentence has none."""
    then: bool = False
    """Whether it comes after the claim before it."""


@dataclass(frozen=True)
class Request:
    """What a prompt asks for."""

    claims: tuple[Claim, ...]
    """The acts, in the order of the prompt."""
    in_turn: bool
    """Whether the acts follow one another; otherwise "while" or the like joins them."""


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


def both_sides(sentence: str) -> list[str]:
    """Returns a sentence, and its mirror image if it names a side."""
    mirrored = mirror_words(sentence)
    return [sentence] if mirrored == sentence else [sentence, mirrored]
