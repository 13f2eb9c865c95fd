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

from latentmotion.data.clip import TAG_RATE, Split, fit_sentences
from latentmotion.data.dataset import Dataset
from latentmotion.data.sources.humanml3d import read_index, read_splits, read_texts, sentences_of
from latentmotion.data.store import COMPOSED
from latentmotion.errors import DataError

SHORTEST, TOO_LONG, LONGEST = 40, 200, 196
"""Frames of HumanML3D's items: left out below the first, from the second on; cut to the third."""

SHORTEST_ACT = 1.6
"""Seconds of the shortest act of a prepared folder; clips may be cut close to what happens."""


@dataclass(frozen=True)
class CaptionLengths:
    """Sentences with the lengths of their motions."""

    sentences: tuple[str, ...]
    """The sentences; several may describe one motion."""
    seconds: Float[np.ndarray, " sentences"]
    """Lengths of their motions, seconds."""


def read_caption_lengths(folder: Path, split: Split) -> CaptionLengths:
    """Reads the sentences of a split with lengths, unmirrored.

    Args:
        folder: HumanML3D's folder with texts, train.txt, val.txt, test.txt and index.csv.
        split: Name of the split.

    Raises:
        DataError: A file is missing or damaged, or the split has no sentence.
    """
    splits, texts = read_splits(folder), read_texts(folder)
    sentences: list[str] = []
    seconds: list[float] = []
    for row in read_index(folder):
        frames = max(row.end - row.start - 1, 0)
        if row.end < 0 and (span := re.search(r"F(\d+)T(\d+)", row.path)):  # HumanAct12's names
            frames = max(int(span[2]) - int(span[1]), 0)
        if splits.get(row.id) != split or not frames:
            continue
        for caption in fit_sentences(sentences_of(texts, row.id), frames)[0]:
            length = caption.end_frame - caption.start_frame
            if SHORTEST <= length < TOO_LONG:
                sentences.append(caption.text)
                seconds.append(min(length, LONGEST) / TAG_RATE)
    if not sentences:
        raise DataError(f"{folder}: no sentence of the split {split} has a length in index.csv")
    return CaptionLengths(tuple(sentences), np.array(seconds, np.float32))


def prepared_caption_lengths(dataset: Dataset, split: Split) -> CaptionLengths:
    """Returns the sentences of a prepared folder that describe whole clips, with their lengths.

    Spans inside a clip are cut where a describer saw something, at any length, and composed clips
    are as long as what was put together: neither tells how long people do it.

    Args:
        dataset: The prepared folder.
        split: Name of the split.

    Raises:
        DataError: The split has no such sentence.
    """
    fps = dataset.representation.fps
    rows = [
        (caption.text, max(clip.frames / fps, SHORTEST_ACT))
        for clip in dataset.clips(split)
        for caption in clip.captions
        if clip.source != COMPOSED and caption.end_frame - caption.start_frame == clip.frames
    ]
    if not rows:
        raise DataError(f"{dataset.folder}: no caption of the split {split} tells of a whole clip")
    sentences, seconds = zip(*rows, strict=True)
    return CaptionLengths(sentences, np.array(seconds, np.float32))


def joined(sets: Sequence[CaptionLengths]) -> CaptionLengths:
    """Returns several sets as one."""
    sentences = tuple(sentence for lengths in sets for sentence in lengths.sentences)
    return CaptionLengths(sentences, np.concatenate([lengths.seconds for lengths in sets]))
