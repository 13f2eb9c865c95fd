"""Crops and batches of an epoch, which depend on nothing but seed and epoch.

As in HumanML3D's own reader (docs/reference/mld.md §5), a caption that describes a part of a clip
makes an item of its own, lengths are multiples of a unit of 4 frames, and one crop in three is a
unit shorter than it could be. New here: crops of similar length go into one batch, so that next
to no padding is computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from latentmotion.data.clip import Clip
from latentmotion.errors import InputError


@dataclass(frozen=True)
class Item:
    """A clip, or a part of one, with the sentences that describe exactly that."""

    clip: Clip
    """The clip."""
    start: int
    """First frame."""
    end: int
    """One past the last frame."""
    captions: tuple[str, ...]
    """Sentences; none for motion without words."""

    @property
    def frames(self) -> int:
        """Its length."""
        return self.end - self.start


@dataclass(frozen=True)
class Crop:
    """A window of frames drawn from an item, with one of its sentences."""

    clip: Clip
    """The clip."""
    start: int
    """First frame."""
    frames: int
    """Number of frames, a multiple of the unit."""
    caption: str
    """One of its sentences; empty for motion without words."""


@dataclass(frozen=True)
class Cropping:
    """Lengths of crops."""

    unit: int = 4
    """Lengths are multiples of this."""
    max_frames: int = 196
    """Longest crop."""
    min_frames: int = 8
    """Items shorter than this are left out."""

    def crop(self, item: Item, generator: np.random.Generator) -> Crop:
        """Draws a part of an item and one of its sentences."""
        units = min(item.frames, self.max_frames) // self.unit
        if generator.random() < 1 / 3 and (units - 1) * self.unit >= self.min_frames:
            units -= 1
        frames = units * self.unit
        start = item.start + int(generator.integers(item.frames - frames + 1))
        number = int(generator.integers(max(len(item.captions), 1)))
        caption = item.captions[number] if item.captions else ""
        return Crop(item.clip, start, frames, caption)


def items_of(clips: Iterable[Clip]) -> list[Item]:
    """Returns one item per clip, and one per part of a clip that has sentences of its own.

    A clip all of whose sentences describe parts makes no item of the whole.
    """
    items = []
    for clip in clips:
        spans: dict[tuple[int, int], list[str]] = {}
        for caption in clip.captions:
            spans.setdefault((caption.start_frame, caption.end_frame), []).append(caption.text)
        spans = spans or {(0, clip.frames): []}
        items += [Item(clip, start, end, tuple(texts)) for (start, end), texts in spans.items()]
    return items


def plan_epoch(
    items: Sequence[Item], batch_size: int, cropping: Cropping, seed: int, epoch: int
) -> list[list[Crop]]:
    """Returns the batches of one epoch, each of crops of similar length, in random order.

    Every batch is full; what does not fill one waits for another epoch. Fewer items than
    `batch_size` make one batch of all.

    Raises:
        InputError: No item is long enough.
    """
    items = [item for item in items if item.frames >= max(cropping.min_frames, cropping.unit)]
    if not items:
        raise InputError(
            f"no clip has {cropping.min_frames} frames or more; prepare more data or lower it"
        )
    generator = np.random.default_rng([seed, epoch])
    count = max(len(items) // batch_size, 1)
    chosen = generator.permutation(len(items))[: count * batch_size]
    crops = [cropping.crop(items[index], generator) for index in chosen]
    crops.sort(key=lambda crop: crop.frames)
    batches = [crops[i : i + batch_size] for i in range(0, len(crops), batch_size)]
    return [batches[index] for index in generator.permutation(count)]
