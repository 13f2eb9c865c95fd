"""Batches for training: normalized features, a mask that is True on real frames, sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.sampling import Crop, Cropping, items_of, plan_epoch
from latentmotion.errors import InputError


@dataclass(frozen=True, eq=False)
class Batch:
    """Crops of similar length, padded to the longest."""

    features: Float[torch.Tensor, "batch frames features"]
    """Normalized features; zero on padding."""
    mask: Bool[torch.Tensor, "batch frames"]
    """True on real frames."""
    captions: list[str]
    """One sentence per crop, empty for motion without words."""
    crops: list[Crop]
    """What was cut from where."""

    def __len__(self) -> int:
        return len(self.captions)


class LengthBatches:
    """Endless epochs of batches of similar length, the same for the same seed.

    Args:
        dataset: Where features come from.
        clips: The clips to show, e.g. `dataset.clips("train", mirrored=True)`.
        batch_size: Crops per batch, over all ranks together.
        seed: Changes the order, the crops and the choice of sentences.
        unit: Lengths are multiples of this.
        max_frames: Longest crop.
        min_frames: Shorter clips are left out.
        rank: Which of `world` processes this is; it gets every `world`-th crop of each batch.
        world: Number of processes.

    Raises:
        InputError: `batch_size` cannot be split among the ranks.
    """

    def __init__(
        self,
        dataset: Dataset,
        clips: Sequence[Clip],
        batch_size: int,
        seed: int,
        unit: int = 4,
        max_frames: int = 196,
        min_frames: int = 8,
        rank: int = 0,
        world: int = 1,
    ) -> None:
        if batch_size % world:
            raise InputError(f"a batch of {batch_size} cannot be split among {world} processes")
        self.dataset = dataset
        self.batch_size = batch_size
        self.seed = seed
        self.cropping = Cropping(unit, max_frames, min_frames)
        self.items = [item for item in items_of(clips) if item.frames >= max(min_frames, unit)]
        self.rank, self.world = rank, world

    def __len__(self) -> int:
        """Batches per epoch."""
        return max(len(self.items) // self.batch_size, 1)

    def plan(self, epoch: int) -> list[list[Crop]]:
        """Returns the crops of an epoch's batches, over all ranks together; reads no features."""
        return plan_epoch(self.items, self.batch_size, self.cropping, self.seed, epoch)

    def epoch(self, epoch: int, start: int = 0) -> Iterator[Batch]:
        """Yields the batches of an epoch from number `start` on, this rank's share of each."""
        for crops in self.plan(epoch)[start:]:
            longest = max(crop.frames for crop in crops)
            yield self.batch(crops[self.rank :: self.world], longest)

    def batch(self, crops: Sequence[Crop], frames: int) -> Batch:
        """Reads crops and pads them to `frames`."""
        width = self.dataset.representation.width
        features = np.zeros((len(crops), frames, width), np.float32)
        for row, crop in zip(features, crops, strict=True):
            whole = self.dataset.features(crop.clip)
            part = whole[crop.start : crop.start + crop.frames]
            row[: crop.frames] = self.dataset.normalizer.normalize(part)
        lengths = torch.tensor([crop.frames for crop in crops])
        return Batch(
            features=torch.from_numpy(features),
            mask=torch.arange(frames)[None] < lengths[:, None],
            captions=[crop.caption for crop in crops],
            crops=list(crops),
        )
