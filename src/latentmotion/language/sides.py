"""Left and right in a sentence, which a mirrored motion swaps."""

from __future__ import annotations

import re

_OTHER_SIDE = {"left": "right", "right": "left", "clockwise": "counterclockwise"}
"""Replacements of words; all spellings of counterclockwise become clockwise."""

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
