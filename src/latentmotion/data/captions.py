"""Captions as HumanML3D writes them: `sentence#word/POS word/POS#from#to`, one a line.

`from` and `to` are seconds; both zero means the whole motion, `nan` counts as zero. A part covers
the frames [int(20 from), int(20 to)), at KIT's 12.5 frames per second as well.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from latentmotion.data.clip import Caption

TAG_RATE = 20
"""Frames per second by which HumanML3D turns `from` and `to` into frames."""

_OTHER_SIDE = {"left": "right", "right": "left", "clockwise": "counterclockwise"}
"""What a word becomes; all ways to write counterclockwise become clockwise."""

# Endings such as "leftward", "rights" and "left-handed" follow; "upright", "frightened" must not.
_SIDED = re.compile(
    r"\b(?:(left|right)(?=s?\b|wards?\b|most\b|ies\b|y\b)|((?:counter|anti)[- ]?)?clock-?wise\b)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class TaggedSentence:
    """One line of a caption file, not yet fitted to a motion."""

    text: str
    """The sentence."""
    tokens: str = ""
    """`word/POS` tokens, separated by spaces."""
    start: float = 0.0
    """Seconds; zero in both means the whole motion."""
    end: float = 0.0
    """Seconds."""


def mirror_words(text: str) -> str:
    """Swaps left and right, clockwise and counterclockwise, in a sentence."""
    return _SIDED.sub(_swap, text)


def mirror_sentence(sentence: TaggedSentence) -> TaggedSentence:
    """Returns the sentence about the same motion seen in a mirror."""
    return TaggedSentence(
        mirror_words(sentence.text), mirror_words(sentence.tokens), sentence.start, sentence.end
    )


def parse_sentences(text: str) -> tuple[TaggedSentence, ...]:
    """Reads a caption file; a line without HumanML3D's tags is a plain sentence."""
    return tuple(_parse_line(line.strip()) for line in text.splitlines() if line.strip())


def fit_sentences(
    sentences: Iterable[TaggedSentence], frames: int
) -> tuple[tuple[Caption, ...], tuple[str, ...]]:
    """Turns seconds into frames of a motion that has `frames` of them.

    Returns:
        The captions, and for each sentence that tells of no frame at all the reason why.
    """
    fitted = [_fit(sentence, frames) for sentence in sentences]
    captions = tuple(item for item in fitted if isinstance(item, Caption))
    return captions, tuple(item for item in fitted if isinstance(item, str))


def _fit(sentence: TaggedSentence, frames: int) -> Caption | str:
    if sentence.start == sentence.end == 0:
        return Caption(sentence.text, 0, frames, sentence.tokens)
    start, end = int(sentence.start * TAG_RATE), int(sentence.end * TAG_RATE)
    if not 0 <= start < end:
        return f"caption tagged from {sentence.start:g} s to {sentence.end:g} s: {sentence.text}"
    if start >= frames:
        return f"caption starts past the end ({start} of {frames} frames): {sentence.text}"
    return Caption(sentence.text, start, min(end, frames), sentence.tokens)


def _parse_line(line: str) -> TaggedSentence:
    parts = line.rsplit("#", 3)
    start, end = (_seconds(part) for part in parts[-2:]) if len(parts) == 4 else (None, None)
    if start is None or end is None:
        return TaggedSentence(line)
    return TaggedSentence(parts[0].strip(), parts[1].strip(), start, end)


def _seconds(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return 0.0 if math.isnan(value) else value


def _swap(match: re.Match[str]) -> str:
    word = match.group(0)
    other = _OTHER_SIDE.get(word.lower().replace("clock-wise", "clockwise"), "clockwise")
    return other.capitalize() if word[0].isupper() else other
