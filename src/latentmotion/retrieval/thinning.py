"""Thinning of a large index: rare movements with all their clips, frequent ones by examples.

Of 78,000 captions of 3,700 clips, most say in other words what others say. What is kept: captions
of rare movements, without those that the same clip has in nearly the same words; and of frequent
movements enough captions that every sentence of the data is near one, so that it is still known.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np

from latentmotion.arrays import unit
from latentmotion.retrieval.index import ClipIndex

SUPPORT = 60
"""Support up to which all captions of different meaning are kept."""

SAME_OF_CLIP, SAME_OF_ALL = 0.8, 0.8
"""Cosines from which two captions of one clip, and two of frequent movements, say the same."""


def thinned(index: ClipIndex) -> ClipIndex:
    """Returns an index without captions that say again what others say, and clips without any."""
    vectors = unit(index.embeddings.astype(np.float32))
    rare: dict[int, list[int]] = defaultdict(list)
    frequent: dict[str, int] = {}
    # Whole clips first, and of equal spans the rarest sentences, which name the movement best.
    order = sorted(
        range(len(index.captions)),
        key=lambda row: (
            index.captions[row].support,
            index.captions[row].start - index.captions[row].end,
        ),
    )
    for row in order:
        caption = index.captions[row]
        if caption.support > SUPPORT:
            frequent.setdefault(caption.text, row)
            continue
        own = rare[caption.clip]
        if not own or float((vectors[own] @ vectors[row]).max()) < SAME_OF_CLIP:
            own.append(row)
    kept = sorted(
        [*(row for rows in rare.values() for row in rows), *_spread(vectors, [*frequent.values()])]
    )
    return _with_rows(index, kept)


def _spread(vectors: np.ndarray, rows: list[int]) -> list[int]:
    """Returns rows none of which is near another, such that each of `rows` is near one."""
    far = np.empty((len(rows), vectors.shape[1]), np.float32)
    kept: list[int] = []
    for row in rows:
        if not kept or float((far[: len(kept)] @ vectors[row]).max()) < SAME_OF_ALL:
            far[len(kept)] = vectors[row]
            kept.append(row)
    return kept


def _with_rows(index: ClipIndex, rows: list[int]) -> ClipIndex:
    """Returns an index of some captions and the clips that they are of."""
    numbers = sorted({index.captions[row].clip for row in rows})
    clips, latents, first = [], [], 0
    for number in numbers:
        clip = index.clips[number]
        latents.append(index.latents[clip.start : clip.start + clip.tokens])
        clips.append(replace(clip, start=first))
        first += clip.tokens
    place = {number: n for n, number in enumerate(numbers)}
    captions = tuple(
        replace(index.captions[row], clip=place[index.captions[row].clip]) for row in rows
    )
    return replace(
        index,
        clips=tuple(clips),
        captions=captions,
        latents=np.concatenate(latents),
        embeddings=index.embeddings[rows],
    )
