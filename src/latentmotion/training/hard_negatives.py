"""Batches of hard contrasts: alike sentences together, and every crop beside its mirror image.

A pool of crops of similar length is halved again and again along the main direction of their
sentences' embeddings, until a few alike ones are left: other counts, other directions, other
windows of the same act. A batch is some of these groups and the mirror image of each crop, whose
sentence has left and right swapped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from latentmotion.data.clip import Clip, mirror_words
from latentmotion.data.dataset import Crop, Cropping, items_of
from latentmotion.errors import InputError
from latentmotion.training.rarity import Embed, RarityDraws
from latentmotion.training.vae import BatchSampler


@dataclass(frozen=True)
class HardNegatives:
    """Hardness of the contrasts of a batch."""

    alike: int = 16
    """Crops of a group with alike sentences."""
    pool: int = 8
    """Batches among whose crops alike sentences are looked for."""


class HardBatchSampler:
    """Which crops each step shows; the second half of a batch mirrors the first.

    Args:
        clips: Clips with captions, and the mirrored copy of each.
        batch_size: Crops of a step, mirror images included.
        cropping: Lengths of crops.
        hard: Similarity of the crops of a group.
        seed: Changes order and crops.
        embed: Sentences to embeddings.
        draws: Weights of rare sentences.

    Raises:
        InputError: There are no mirrored copies.
    """

    def __init__(
        self,
        clips: Sequence[Clip],
        batch_size: int,
        cropping: Cropping,
        hard: HardNegatives,
        seed: int,
        embed: Embed,
        draws: RarityDraws,
    ) -> None:
        self._twins = {clip.id.removeprefix("M"): clip for clip in clips if clip.mirrored}
        if not self._twins:
            raise InputError("hard negatives are mirror images; leave mirrored=false out")
        items = draws.weigh(items_of(clip for clip in clips if not clip.mirrored), embed)
        self._half, self._hard, self._seed, self._embed = batch_size // 2, hard, seed, embed
        self._pools = BatchSampler(items, hard.pool * self._half, cropping, seed)
        self._ordered = lru_cache(maxsize=1)(self._order)

    def __call__(self, step: int) -> list[Crop]:
        """Returns the crops of step number `step`."""
        number, part = divmod(step, self._hard.pool)
        crops = self._ordered(number)
        # A small data set's pool is one batch or less.
        parts = max(len(crops) // self._half, 1)
        chosen = crops[part % parts * self._half :][: self._half]
        twins = []
        for crop in chosen:
            twin, mirrored = self._twins[crop.clip.id], mirror_words(crop.caption)
            numbers = [n for n, c in enumerate(crop.clip.captions) if c.text == crop.caption]
            texts = [caption.text for caption in twin.captions]
            # Official mirrored captions are the data set's own.
            caption = mirrored if mirrored in texts else texts[numbers[0] % len(texts)]
            twins.append(Crop(twin, crop.start, crop.frames, caption))
        return [*chosen, *twins]

    def _order(self, number: int) -> list[Crop]:
        """Returns the crops of a pool, alike ones next to each other."""
        crops = self._pools(number)
        embeddings = self._embed([crop.caption for crop in crops])
        groups = alike_groups(embeddings, self._hard.alike)
        order = np.random.default_rng([self._seed, number]).permutation(len(groups))
        return [crops[row] for group in order for row in groups[group]]


def alike_groups(
    embeddings: Float[np.ndarray, "rows width"], most: int
) -> list[Int[np.ndarray, " _"]]:
    """Returns the rows in groups of at most `most` that lie close together."""
    groups = [np.arange(len(embeddings))]
    while max(map(len, groups)) > most:
        halves = []
        for rows in groups:
            centered = embeddings[rows] - embeddings[rows].mean(axis=0)
            direction = np.linalg.eigh(centered.T @ centered)[1][:, -1]
            ordered = rows[np.argsort(centered @ direction, kind="stable")]
            halves += [ordered[: len(rows) // 2], ordered[len(rows) // 2 :]]
        groups = halves
    return groups
