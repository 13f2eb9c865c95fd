"""Teaching by showing: clips and sentences become an index that sampling starts from, untrained.

features → the VAE's encoder → codes of latents;   sentences → codes of embeddings

Support of a sentence: the number of clips that have one of nearly the same meaning.

    support(s) = #{clips with a caption c : cos(embedding(s), embedding(c)) ≥ 0.7}

It tells rare movements from frequent ones without a list of words: "a person sweeps the floor" has
a support of 1, "a person walks forward" one of 1,800 (lab/diary/rare_acts.md).

Thinning of a large index: rare movements with all their clips, frequent ones by examples.

Of 78,000 captions of 3,700 clips, most say in other words what others say. What is kept: captions
of rare movements, without those that the same clip has in nearly the same words; and of frequent
movements enough captions that every sentence of the data is near one, so that it is still known.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from latentmotion.arrays import unit
from latentmotion.data.clip import Caption, Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import COMPOSED
from latentmotion.diffusion.condition import TextEncoder
from latentmotion.errors import InputError
from latentmotion.language.words import words_of
from latentmotion.model.card import ModelCard
from latentmotion.retrieval.index import (
    ALL_DIRECTIONS,
    EMBEDDING_LEVELS,
    LATENT_LEVELS,
    ClipIndex,
    IndexedCaption,
    IndexedClip,
    fingerprint,
    quantized,
)
from latentmotion.retrieval.wordings import embedded


@dataclass(frozen=True, eq=False)
class ShownClip:
    """A clip with sentences about it."""

    id: str  # Unique name.
    source: str  # Name of its owner's source.
    origin: str  # The recording.
    features: Float[np.ndarray, "frames features"]  # In their own units.
    captions: tuple[Caption, ...]  # Sentences about it or about parts of it.


def build_index(
    clips: Iterable[ShownClip],
    sources: Sequence[Source],
    card: ModelCard,
    encoder: Callable[[Float[np.ndarray, "frames features"]], Float[np.ndarray, "tokens width"]],
    text_encoder: TextEncoder,
) -> ClipIndex:
    """Returns an index of clips for a model.

    Args:
        clips: With features of the model's kind.
        sources: Owners of the clips, with their terms.
        card: The model.
        encoder: Its VAE's encoder, or what else finds latents of features.
        text_encoder: Its text encoder.

    Raises:
        InputError: There is no clip with a sentence.
    """
    indexed: list[IndexedClip] = []
    rows: list[tuple[Caption, int]] = []
    latents: list[Float[np.ndarray, "tokens width"]] = []
    per_token, first = card.latents.frames_per_token or 1, 0
    for clip in clips:
        if not clip.captions:
            continue
        # A token that is padded decodes to the mean pose: somebody who lies would rise in the end.
        z = encoder(clip.features[: len(clip.features) // per_token * per_token or None])
        rows += [(caption, len(indexed)) for caption in clip.captions]
        indexed.append(IndexedClip(clip.id, clip.source, clip.origin, first, len(z)))
        latents.append(z)
        first += len(z)
    if not indexed:
        raise InputError("no clip with a sentence to teach; give at least one of each")
    texts = list(dict.fromkeys(caption.text for caption, _ in rows))
    embeddings, number = embedded(texts, text_encoder), {text: n for n, text in enumerate(texts)}
    numbers_of_clip: list[list[int]] = [[] for _ in indexed]
    for caption, clip in rows:
        numbers_of_clip[clip].append(number[caption.text])
    counts = support(embeddings, embeddings, numbers_of_clip)
    captions = tuple(
        IndexedCaption(
            caption.text,
            clip,
            start := min(caption.start_frame // per_token, indexed[clip].tokens - 1),
            max(min(-(-caption.end_frame // per_token), indexed[clip].tokens), start + 1),
            int(counts[number[caption.text]]),
        )
        for caption, clip in rows
    )
    words = Counter(
        word
        for rows_of_clip in numbers_of_clip
        for word in {word for row in rows_of_clip for word in words_of(texts[row])}
    )
    codes, scale = quantized(np.concatenate(latents), 0, LATENT_LEVELS)
    used = {clip.source for clip in indexed}
    return ClipIndex(
        text_encoder.name,
        fingerprint(card.latents),
        tuple(source for source in sources if source.name in used),
        tuple(indexed),
        captions,
        codes,
        scale,
        np.zeros(0, np.int32),
        quantized(embeddings, 1, EMBEDDING_LEVELS)[0][
            [number[caption.text] for caption, _ in rows]
        ],
        ALL_DIRECTIONS,
        dict(words),
    )


def shown_clips(dataset: Dataset) -> Iterator[ShownClip]:
    """Yields the recorded clips of the train split of prepared data that have captions."""
    for clip in dataset.clips("train"):
        if clip.source != COMPOSED and clip.captions:
            features = dataset.features(clip)
            yield ShownClip(clip.id, clip.source, clip.origin, features, tuple(clip.captions))


NEAR = 0.7  # Cosine of pooled embeddings from which two sentences usually name the same movement.

# Sentences that are compared with all captions together.
_AT_ONCE = 512


def support(
    sentences: Float[np.ndarray, "sentences width"],
    captions: Float[np.ndarray, "captions width"],
    clips: Sequence[Sequence[int]],
    near: float = NEAR,
) -> Int[np.ndarray, " sentences"]:
    """Returns how many clips have a caption near each sentence.

    Args:
        sentences: Pooled embeddings of unit length.
        captions: Those of different captions.
        clips: Rows of the captions of each clip; every clip has at least one.
        near: Least cosine.
    """
    if not clips:
        return np.zeros(len(sentences), np.int64)
    rows = np.concatenate([np.asarray(numbers, np.int64) for numbers in clips])
    starts = np.cumsum([0, *(len(numbers) for numbers in clips[:-1])])
    counts = []
    for first in range(0, len(sentences), _AT_ONCE):
        close = sentences[first : first + _AT_ONCE] @ captions.T >= near
        counts.append(np.logical_or.reduceat(close[:, rows], starts, axis=1).sum(axis=1))
    return np.concatenate(counts)


SUPPORT = 60  # Support up to which all captions of different meaning are kept.

# Cosines from which two captions of one clip, and two of frequent movements, say the same.
SAME_OF_CLIP, SAME_OF_ALL = 0.8, 0.8


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
        rows_of_clip = rare[caption.clip]
        if not rows_of_clip or float((vectors[rows_of_clip] @ vectors[row]).max()) < SAME_OF_CLIP:
            rows_of_clip.append(row)
    # Of the frequent ones none is near another, and each that is left out is near one.
    far = np.empty((len(frequent), vectors.shape[1]), np.float32)
    spread: list[int] = []
    for row in frequent.values():
        if not spread or float((far[: len(spread)] @ vectors[row]).max()) < SAME_OF_ALL:
            far[len(spread)] = vectors[row]
            spread.append(row)
    return _with_rows(index, sorted([*(row for rows in rare.values() for row in rows), *spread]))


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
