"""Captions in HumanML3D's format, one a line: `sentence#word/POS word/POS#from#to`.

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

_MOST_SECONDS = 1e6
"""Seconds from which a time is taken for damage, infinite ones too."""

_OTHER_SIDE = {"left": "right", "right": "left", "clockwise": "counterclockwise"}
"""Replacements of words; all spellings of counterclockwise become clockwise."""

# Endings such as "leftward", "rights" and "left-handed" follow; "upright", "frightened" must not.
_SIDED = re.compile(
    r"\b(?:(left|right)(?=s?\b|wards?\b|most\b|ies\b|y\b)|((?:counter|anti)[- ]?)?clock-?wise\b)",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class TaggedSentence:
    """One line of a caption file, with seconds that are not yet frames of a motion."""

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

    def swap(match: re.Match[str]) -> str:
        word = match.group(0)
        other = _OTHER_SIDE.get(word.lower().replace("clock-wise", "clockwise"), "clockwise")
        return other.capitalize() if word[0].isupper() else other

    return _SIDED.sub(swap, text)


def mirror_sentence(sentence: TaggedSentence) -> TaggedSentence:
    """Returns the sentence about the mirror image of the same motion."""
    return TaggedSentence(
        mirror_words(sentence.text), mirror_words(sentence.tokens), sentence.start, sentence.end
    )


def parse_sentences(text: str) -> tuple[TaggedSentence, ...]:
    """Reads a caption file; a line without HumanML3D's tags is a plain sentence."""
    sentences = []
    for line in filter(None, map(str.strip, text.splitlines())):
        try:
            sentence, tokens, *span = line.rsplit("#", 3)
            start, end = (0.0 if math.isnan(time) else time for time in map(float, span))
        except ValueError:  # no tags
            sentences.append(TaggedSentence(line))
        else:
            sentences.append(TaggedSentence(sentence.strip(), tokens.strip(), start, end))
    return tuple(sentences)


def fit_sentences(
    sentences: Iterable[TaggedSentence], frames: int
) -> tuple[tuple[Caption, ...], tuple[str, ...]]:
    """Turns seconds into frames of a motion that has `frames` of them.

    Returns:
        The captions, and the reasons why the other sentences describe no frame.
    """
    captions, reasons = [], []
    for sentence in sentences:
        finite = abs(sentence.start) < _MOST_SECONDS and abs(sentence.end) < _MOST_SECONDS
        start = int(sentence.start * TAG_RATE) if finite else -1
        end = int(sentence.end * TAG_RATE) if finite else -1
        if sentence.start == sentence.end == 0:
            captions.append(Caption(sentence.text, 0, frames, sentence.tokens))
        elif not 0 <= start < end:
            span = f"{sentence.start:g} s to {sentence.end:g} s"
            reasons.append(f"caption tagged from {span}: {sentence.text}")
        elif start >= frames:
            reasons.append(
                f"caption starts past the end ({start} of {frames} frames): {sentence.text}"
            )
        else:
            captions.append(Caption(sentence.text, start, min(end, frames), sentence.tokens))
    return tuple(captions), tuple(reasons)
