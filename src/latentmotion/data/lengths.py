"""Captions with the lengths of their motions, of HumanML3D without motions or of a prepared set.

HumanML3D's lengths follow from index.csv as its own readers make them: features have one frame less
than the clip, a sentence tagged with a span lasts as long as that, items under 40 or from 200
frames on are left out, what is longer than 196 is cut. Clips of 10 s are mostly cut from longer
ones, so the longest length means "that or more".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.annotations import (
    IndexRow,
    read_index,
    read_splits,
    read_texts,
    sentences_of,
)
from latentmotion.data.captions import TAG_RATE, fit_sentences
from latentmotion.data.clip import Split
from latentmotion.data.dataset import Dataset
from latentmotion.describe.claims import claims_of
from latentmotion.errors import DataError

SHORTEST, TOO_LONG, LONGEST = 40, 200, 196
"""Frames of HumanML3D's items: fewer are left out, so many are left out, more are cut."""

SHORTEST_ACT = 1.6
"""Seconds of the shortest act of a prepared folder; spans are cut close to what happens."""

ACTS = frozenset(
    {"turn", "circle", "jump", "hop", "kick", "punch", "wave", "raise", "clap", "knee", "squat",
     "bow", "pick_up", "arm_circle", "sit_down", "stand_up", "lie_down", "kneel_down", "stop"}
)  # fmt: skip
"""Kinds of claims about something that begins and ends."""


@dataclass(frozen=True)
class CaptionLengths:
    """Sentences and how long each one's motion is."""

    sentences: tuple[str, ...]
    """The sentences; several may tell of one motion."""
    seconds: Float[np.ndarray, " sentences"]
    """Lengths."""


def read_caption_lengths(folder: Path, split: Split) -> CaptionLengths:
    """Reads the sentences of a split with lengths, unmirrored.

    Args:
        folder: HumanML3D's folder with texts, train.txt, val.txt, test.txt and index.csv.
        split: Which part.

    Raises:
        DataError: A file is missing or damaged, or the split has no sentence.
    """
    splits, texts = read_splits(folder), read_texts(folder)
    found = [
        (caption.text, min(caption.end_frame - caption.start_frame, LONGEST) / TAG_RATE)
        for row in read_index(folder)
        if splits.get(row.id) == split and (frames := _frames(row))
        for caption in fit_sentences(sentences_of(texts, row.id), frames)[0]
        if SHORTEST <= caption.end_frame - caption.start_frame < TOO_LONG
    ]
    if not found:
        raise DataError(f"{folder}: no sentence of the split {split} has a length in index.csv")
    sentences, seconds = zip(*found, strict=True)
    return CaptionLengths(sentences, np.array(seconds, np.float32))


def prepared_caption_lengths(
    dataset: Dataset, split: Split, most: int, seed: int = 0
) -> CaptionLengths:
    """Returns sentences of a prepared folder that tell of acts, with the lengths of their spans.

    What goes on without an end (walking, sitting, standing) has no length of its own: sentences of
    nothing else are left out, since their spans are cut anywhere.

    Args:
        dataset: The prepared folder.
        split: Which part.
        most: Most sentences; more are drawn at random.
        seed: What draws them.

    Raises:
        DataError: The split has no such sentence.
    """
    fps = dataset.representation.fps
    found = [
        (caption.text, max((caption.end_frame - caption.start_frame) / fps, SHORTEST_ACT))
        for clip in dataset.clips(split)
        for caption in clip.captions
        if any(claim.kind in ACTS or claim.count for claim in claims_of(caption.text))
    ]
    if not found:
        raise DataError(f"{dataset.folder}: no caption of the split {split} tells of an act")
    rows = np.random.default_rng(seed).permutation(len(found))[:most]
    sentences, seconds = zip(*(found[row] for row in rows), strict=True)
    return CaptionLengths(sentences, np.array(seconds, np.float32))


def joined(parts: Sequence[CaptionLengths]) -> CaptionLengths:
    """Returns several sets as one."""
    sentences = tuple(sentence for part in parts for sentence in part.sentences)
    return CaptionLengths(sentences, np.concatenate([part.seconds for part in parts]))


def _frames(row: IndexRow) -> int:
    """Returns how many frames of features a clip has; 0 where the index does not tell."""
    if row.end >= 0:
        return max(row.end - row.start - 1, 0)
    span = re.search(r"F(\d+)T(\d+)", row.path)  # HumanAct12's names tell
    return max(int(span[2]) - int(span[1]), 0) if span else 0
