"""Teaching by showing: clips and sentences become an index that sampling starts from, untrained.

features → the VAE's encoder → codes of latents;   sentences → codes of embeddings
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.condition.interface import TextEncoder
from latentmotion.data.clip import Caption, Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import COMPOSED
from latentmotion.engine.backend import FeatureEncoder
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
from latentmotion.retrieval.support import support
from latentmotion.retrieval.wordings import embedded


@dataclass(frozen=True, eq=False)
class ShownClip:
    """A clip with sentences about it."""

    id: str
    """Unique name."""
    source: str
    """Name of its owner's source."""
    origin: str
    """The recording."""
    features: Float[np.ndarray, "frames features"]
    """In their own units."""
    captions: tuple[Caption, ...]
    """Sentences about it or about parts of it."""


def build_index(
    clips: Iterable[ShownClip],
    sources: Sequence[Source],
    card: ModelCard,
    encoder: FeatureEncoder,
    text_encoder: TextEncoder,
) -> ClipIndex:
    """Returns an index of clips for a model.

    Args:
        clips: With features of the model's kind.
        sources: Owners of the clips, with their terms.
        card: The model.
        encoder: Its VAE's encoder.
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
    own: list[list[int]] = [[] for _ in indexed]
    for caption, clip in rows:
        own[clip].append(number[caption.text])
    counts = support(embeddings, embeddings, own)
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
        for rows_of_clip in own
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


def shown_clips(dataset: Dataset, held_out: Container[str] = frozenset()) -> Iterator[ShownClip]:
    """Yields the recorded clips of the train split of prepared data.

    Args:
        dataset: Prepared data.
        held_out: Sentences that no caption may be: those of a test set.
    """
    for clip in dataset.clips("train"):
        captions = tuple(caption for caption in clip.captions if caption.text not in held_out)
        if clip.source != COMPOSED and captions:
            features = dataset.features(clip)
            yield ShownClip(clip.id, clip.source, clip.origin, features, captions)
