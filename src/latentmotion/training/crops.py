"""The crops of a step, found from its number alone; features are kept in memory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float

from latentmotion.arrays import prefix_mask
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.sampling import Crop, Cropping, Item, items_of, plan_epoch
from latentmotion.errors import DataError
from latentmotion.representation.normalizer import Normalizer


class BatchSampler:
    """Which crops each step shows: epochs of items in random order, batches of similar length.

    Args:
        items: What to show.
        batch_size: Crops of a step.
        cropping: Which lengths crops have.
        seed: Changes order and crops.
    """

    def __init__(
        self, items: Sequence[Item], batch_size: int, cropping: Cropping, seed: int
    ) -> None:
        shortest = max(cropping.min_frames, cropping.unit)
        self._items = [item for item in items if item.frames >= shortest]
        self._arguments = batch_size, cropping, seed
        self._per_epoch = max(len(self._items) // batch_size, 1)
        self._epoch = lru_cache(maxsize=1)(self._plan_epoch)

    def __call__(self, step: int) -> list[Crop]:
        """Returns the crops of step number `step`."""
        epoch, index = divmod(step, self._per_epoch)
        return self._epoch(epoch)[index]

    def _plan_epoch(self, epoch: int) -> list[list[Crop]]:
        return plan_epoch(self._items, *self._arguments, epoch)


class FeatureCache:
    """Features of clips, read once and given out normalized, each crop as a clip of its own.

    Args:
        dataset: Where features come from.
        clips: Which are read.
        normalizer: What they are normalized by.

    Raises:
        DataError: There is no clip.
        InputError: The features are not normalized: the normalizer is of other data.
    """

    def __init__(self, dataset: Dataset, clips: Sequence[Clip], normalizer: Normalizer) -> None:
        self._features = {clip.id: dataset.features(clip) for clip in clips}
        self._normalizer, self._representation = normalizer, dataset.representation
        if not self._features:
            raise DataError("no clip to train on; see what there is: latentmotion data check")
        if self._representation.normalized:
            every = np.concatenate(list(self._features.values()))
            normalizer.check(normalizer.normalize(every), self._representation.blocks)

    def batch(
        self, crops: Sequence[Crop], frames: int
    ) -> tuple[Float[torch.Tensor, "batch frames features"], Bool[torch.Tensor, "batch frames"]]:
        """Returns crops padded with zeros to `frames`, and the mask of what is real."""
        parts = [self._part(crop) for crop in crops]
        features = np.zeros((len(crops), frames, parts[0].shape[1]), np.float32)
        for row, part in zip(features, parts, strict=True):
            row[: len(part)] = part
        lengths = torch.tensor([crop.frames for crop in crops])
        return torch.from_numpy(features), prefix_mask(lengths, frames)

    def _part(self, crop: Crop) -> Float[np.ndarray, "frames features"]:
        part = self._features[crop.clip.id][crop.start : crop.start + crop.frames]
        return self._normalizer.normalize(self._representation.restart(part))


def items_by_length(clips: Sequence[Clip], most: int) -> list[Item]:
    """Returns the items of clips, one that has room for n crops of `most` frames n times."""
    return [item for item in items_of(clips) for _ in range(math.ceil(item.frames / most))]
