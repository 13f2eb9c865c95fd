"""A prepared folder in Python: clips by split; the crops and batches of an epoch.

As in HumanML3D's own reader (docs/reference/mld.md §5), a caption that describes a part of a clip
makes an item of its own, lengths are multiples of a unit of 4 frames, and one crop in three is a
unit shorter than it could be. New here: crops of similar length go into one batch, so that next
to no padding is computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError, safe_open

from latentmotion.data.clip import SPLITS, Clip, Source
from latentmotion.data.pack_file import unpacked
from latentmotion.data.store import MANIFEST, DatasetManifest, StoredClip, read_manifest
from latentmotion.errors import DataError, InputError
from latentmotion.representation import representation_named
from latentmotion.representation.interface import Normalizer, Representation
from latentmotion.storage.files import sha256


@dataclass(frozen=True, eq=False)
class Dataset:
    """Motions ready for training; features are read from disk on demand."""

    folder: Path
    """The prepared folder."""
    manifest: DatasetManifest
    """Its manifest."""
    representation: Representation
    """Representation of its features."""

    @classmethod
    def load(cls, folder: str | Path) -> Dataset:
        """Opens a folder that `latentmotion data prepare` made, or a pack of one.

        A pack is unpacked into the user's cache when it is opened for the first time.

        Raises:
            DataError: It is not such a folder, or it is damaged.
            FileFormatError: The file is no pack, of another version or damaged.
        """
        if Path(folder).is_file():
            folder = unpacked(Path(folder))
        manifest = read_manifest(folder)
        try:
            representation = representation_named(manifest.representation)
        except InputError as error:
            raise DataError(f"{folder}: {error}; prepare the folder again") from error
        return cls(Path(folder), manifest, representation)

    @cached_property
    def normalizer(self) -> Normalizer:
        """Mean and standard deviation of its features."""
        try:
            return self.manifest.normalizer.opened(self.representation.width)
        except InputError as error:
            raise DataError(f"{self.folder}: {error}; prepare the folder again") from error

    @property
    def sources(self) -> tuple[Source, ...]:
        """Origins of its motions, with the terms of their owners."""
        return self.manifest.sources

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the whole folder, for caches and provenance."""
        return sha256(self.folder / MANIFEST)

    def clips(self, split: str, mirrored: bool = False) -> list[Clip]:
        """Returns the clips of one split.

        Args:
            split: `train`, `val` or `test`.
            mirrored: Whether the mirrored copy of each clip follows it.

        Raises:
            DataError: There is no such split.
        """
        sides = (False, True) if mirrored else (False,)
        stored = (clip for clip in self._of(split) if not clip.is_mirrored_copy)
        return [clip.clip(side) for clip in stored for side in sides]

    def mirrored_copies(self, split: str) -> list[Clip]:
        """Returns the mirrored copies that the authors of the data list as clips of a split.

        Raises:
            DataError: There is no such split.
        """
        return [clip.clip() for clip in self._of(split) if clip.is_mirrored_copy]

    def _of(self, split: str) -> list[StoredClip]:
        if split not in SPLITS:
            raise DataError(f"unknown split {split!r}, known are {', '.join(SPLITS)}")
        return [clip for clip in self.manifest.clips if clip.split == split]

    def features(self, clip: Clip) -> Float[np.ndarray, "frames features"]:
        """Returns the features of a clip, not normalized, float32.

        Raises:
            DataError: The clip is not in this folder, or its shard is damaged.
        """
        copy = self._stored.get(clip.id) if clip.mirrored else None
        computed = clip.mirrored and not (copy and copy.is_mirrored_copy)
        name = clip.id.removeprefix("M") if computed else clip.id
        if name not in self._stored:
            raise DataError(f"{self.folder} has no clip {clip.id!r}")
        stored = self._stored[name]
        shard = self.manifest.shards[stored.shard]
        path, expected = self.folder / shard.file, [shard.frames, self.representation.width]
        try:
            with safe_open(path, "np") as opened:
                rows = opened.get_slice("features")
                if rows.get_dtype() != "F32" or rows.get_shape() != expected:
                    actual = f"features {rows.get_shape()} of {rows.get_dtype()}"
                    raise DataError(
                        f"{path}: {actual}, expected {expected} of F32; prepare it again"
                    )
                features = rows[stored.offset : stored.offset + stored.frames]
        except (OSError, SafetensorError) as error:
            raise DataError(f"{path} is damaged ({error}); copy or prepare it again") from error
        if not np.isfinite(features).all():
            raise DataError(
                f"{path}: clip {clip.id} holds NaN or infinity; copy or prepare it again"
            )
        return self.representation.mirror(features) if computed else features

    def actions(self) -> list[str]:
        """Returns the action labels that occur, sorted."""
        return sorted({clip.action for clip in self.manifest.clips if clip.action})

    @cached_property
    def _stored(self) -> dict[str, StoredClip]:
        return {clip.id: clip for clip in self.manifest.clips}


@dataclass(frozen=True)
class Item:
    """A clip, or a part of one, with the sentences that describe exactly that."""

    clip: Clip  # The clip.
    start: int  # First frame.
    end: int  # One past the last frame.
    captions: tuple[str, ...]  # Sentences; none for motion without words.
    # How often each sentence is drawn, relative to others of all items; equally often if empty.
    weights: tuple[float, ...] = ()

    @property
    def frames(self) -> int:
        """Its length."""
        return self.end - self.start

    @property
    def weight(self) -> float:
        """How often the item is drawn, relative to others: as often as its rarest sentence."""
        return max(self.weights, default=1.0)

    def draw_caption(self, generator: np.random.Generator) -> str:
        """Draws one of its sentences; the empty one if there are none."""
        if not self.weights:
            number = int(generator.integers(max(len(self.captions), 1)))
            return self.captions[number] if self.captions else ""
        shares = np.array(self.weights) / sum(self.weights)
        return self.captions[int(generator.choice(len(self.captions), p=shares))]


@dataclass(frozen=True)
class Crop:
    """A window of frames drawn from an item, with one of its sentences."""

    clip: Clip  # The clip.
    start: int  # First frame.
    frames: int  # Number of frames, a multiple of the unit.
    caption: str  # One of its sentences; empty for motion without words.


@dataclass(frozen=True)
class Cropping:
    """Lengths of crops."""

    unit: int = 4  # Lengths are multiples of this.
    max_frames: int = 196  # Longest crop.
    min_frames: int = 8  # Items shorter than this are left out.

    def crop(self, item: Item, generator: np.random.Generator) -> Crop:
        """Draws a part of an item and one of its sentences."""
        units = min(item.frames, self.max_frames) // self.unit
        if generator.random() < 1 / 3 and (units - 1) * self.unit >= self.min_frames:
            units -= 1
        frames = units * self.unit
        start = item.start + int(generator.integers(item.frames - frames + 1))
        return Crop(item.clip, start, frames, item.draw_caption(generator))


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
    `batch_size` make one batch of all. Items with weights are drawn with replacement.

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
    size = min(count * batch_size, len(items))
    if any(item.weights for item in items):
        weights = np.array([item.weight for item in items])
        chosen = generator.choice(len(items), size, p=weights / weights.sum())
    else:
        chosen = generator.permutation(len(items))[:size]
    crops = [cropping.crop(items[index], generator) for index in chosen]
    crops.sort(key=lambda crop: crop.frames)
    batches = [crops[i : i + batch_size] for i in range(0, len(crops), batch_size)]
    return [batches[index] for index in generator.permutation(count)]
