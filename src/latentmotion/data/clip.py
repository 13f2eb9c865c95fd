"""The contents of a data set: sources, clips, and captions in HumanML3D's format.

`from` and `to` are seconds; both zero means the whole motion, `nan` counts as zero. A part covers
the frames [int(20 from), int(20 to)), at KIT's 12.5 frames per second as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from latentmotion.language.claims import mirror_words

Split = Literal["train", "val", "test"]

SPLITS: tuple[Split, ...] = ("train", "val", "test")


@dataclass(frozen=True)
class Source:
    """The origin of motions, with the terms of their owner."""

    name: str
    """Short name, e.g. `cmu`."""
    license: str
    """The owner's terms."""
    credit: str
    """The credit line, in the owner's words where there are such."""
    url: str = ""
    """Address from which the data can be downloaded."""


@dataclass(frozen=True)
class Caption:
    """One sentence about a clip, or about a part of it."""

    text: str  # The sentence.
    start_frame: int  # First frame that it describes.
    end_frame: int  # One past the last frame that it describes.
    # HumanML3D's `word/POS` tokens, separated by spaces; empty where there are none.
    tokens: str = ""


@dataclass(frozen=True)
class Clip:
    """One motion of a prepared folder; `Dataset.features` gives its frames."""

    id: str  # Unique name; a mirrored copy has `M` before the name of the clip it was made from.
    source: str  # Name of its source.
    split: Split  # Its split.
    # Sentences, already mirrored in a mirrored copy; none if there are none.
    captions: tuple[Caption, ...]
    action: str | None  # Action label, already mirrored in a mirrored copy.
    mirrored: bool  # Whether left and right are swapped.
    frames: int  # Number of feature frames.
    origin: str = ""  # The recording and, where it is a part, the frames at the data set's rate.


TAG_RATE = 20  # Frames per second by which HumanML3D turns `from` and `to` into frames.

# Seconds from which a time is taken for damage, infinite ones too.
_MOST_SECONDS = 1e6


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
