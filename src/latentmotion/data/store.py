"""The prepared folder: `manifest.json` and `motions-NNN.safetensors`, written whole or not at all.

A shard holds one array `features` (frames, features), float32, not normalized: its clips one after
another, each stored once. Mirrored copies are computed when they are read. The manifest is read
strictly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from safetensors.numpy import save

from latentmotion.data.clip import Caption, Clip, Source, Split, mirror_words
from latentmotion.errors import DataError, InputError
from latentmotion.representation.interface import Normalizer, Representation
from latentmotion.storage.configuration import read_json, write_json
from latentmotion.storage.files import atomic_folder, sha256

MANIFEST = "manifest.json"
FORMAT = "latentmotion dataset 1"

SHARD_FRAMES = 40_000  # Frames after which a new shard begins: some 40 MB, which every host takes.

# Source of synthetic sequences, which only train: a test set holds recorded motion.
COMPOSED = "composed"

# Folder of the features of HumanML3D and KIT, which are the origin of their clips.
OFFICIAL_FEATURES = "new_joint_vecs"

CaptionRow = tuple[str, int, int, str]  # Text, first frame, one past the last frame, tokens.


@dataclass(frozen=True)
class StoredClip:
    """A clip and its mirror image in a prepared folder, all but their features."""

    id: str  # Unique name.
    source: str  # Name of its source.
    origin: str  # The recording that it was cut from and where.
    split: Split  # Its split.
    frames: int  # Number of feature frames.
    shard: int  # Index of the shard that holds it.
    offset: int  # Its first row there.
    captions: tuple[CaptionRow, ...]  # Sentences about it.
    mirrored_captions: tuple[CaptionRow, ...]  # Sentences about its mirror image.
    action: str | None = None  # Action label.
    mirrored_action: str | None = None  # Action label of its mirror image.

    @property
    def is_mirrored_copy(self) -> bool:
        """Whether it is the mirrored copy of another clip that a data set's authors computed."""
        return self.origin == f"{OFFICIAL_FEATURES}/{self.id}.npy" and self.id.startswith("M")

    def clip(self, mirrored: bool = False) -> Clip:
        """Returns the clip, or its mirrored copy."""
        rows = self.mirrored_captions if mirrored else self.captions
        return Clip(
            id=f"M{self.id}" if mirrored else self.id,
            source=self.source,
            split=self.split,
            captions=tuple(Caption(*row) for row in rows),
            action=self.mirrored_action if mirrored else self.action,
            mirrored=mirrored or self.is_mirrored_copy,
            frames=self.frames,
            origin=self.origin,
        )

    def with_captions(self, rows: Sequence[tuple[str, int, int]]) -> StoredClip:
        """Returns the clip with more captions, whose mirrored ones have left and right swapped.

        Args:
            rows: Text, first frame and one past the last frame of each.
        """
        mirrored = ((mirror_words(text), start, end, "") for text, start, end in rows)
        return replace(
            self,
            captions=(*self.captions, *((*row, "") for row in rows)),
            mirrored_captions=(*self.mirrored_captions, *mirrored),
        )


@dataclass(frozen=True)
class Shard:
    """One file of features."""

    file: str  # Its name in the folder.
    frames: int  # Number of rows.
    sha256: str  # Hash of the file.


@dataclass(frozen=True)
class StoredNormalizer:
    """Mean and standard deviation by which features are normalized."""

    origin: str  # The data they were computed from.
    mean: tuple[float, ...]  # One per feature.
    std: tuple[float, ...]  # One per feature.

    def opened(self, width: int) -> Normalizer:
        """Returns the normalizer of so many features.

        Raises:
            InputError: It is of another number of features, or not of positive numbers.
        """
        with np.errstate(over="ignore"):
            mean, std = (np.array(values, np.float32) for values in (self.mean, self.std))
        if not len(mean) == len(std) == width:
            sizes = f"{len(mean)} and {len(std)}"
            raise InputError(f"a normalizer of {sizes} numbers, expected {width}")
        return Normalizer(mean, std)


@dataclass(frozen=True)
class DatasetManifest:
    """All of a prepared folder but the features themselves."""

    KIND: ClassVar[str] = "Manifest"  # Its name in files.
    format: str  # Name and version of the format.
    representation: str  # Name of the representation of the features.
    fps: float  # Frames per second.
    sources: tuple[Source, ...]  # Origins of the motions, with the terms of their owners.
    normalizer: StoredNormalizer  # Mean and standard deviation of the features.
    shards: tuple[Shard, ...]  # Files of features.
    clips: tuple[StoredClip, ...]  # Clips, in the order in which they lie in the shards.


@dataclass(frozen=True, eq=False)
class StoredMotion:
    """A clip on its way into a folder, where its shard and offset are not yet known."""

    clip: StoredClip  # Everything but its features.
    features: Float[np.ndarray, "frames features"]  # Features, not normalized.


def read_manifest(folder: str | Path) -> DatasetManifest:
    """Reads the manifest of a prepared folder.

    Raises:
        DataError: The folder is not a prepared one, or it is damaged.
    """
    path = Path(folder) / MANIFEST
    if not path.is_file():
        cause = "a folder without it" if path.parent.is_dir() else "no such folder"
        raise DataError(
            f"{folder}: expected a prepared data set ({MANIFEST}), found {cause}; "
            "make one with `latentmotion data prepare`"
        )
    try:
        manifest = read_json(DatasetManifest, path)
    except InputError as error:
        raise DataError(f"{error}; prepare the folder again") from error
    if manifest.format != FORMAT:
        raise DataError(
            f"{path}: expected format {FORMAT!r}, found {manifest.format!r}; prepare it again"
        )
    for shard in manifest.shards:
        if not (path.parent / shard.file).is_file():
            raise DataError(f"{path.parent}: lacks {shard.file}; copy it there or prepare again")
        if (path.parent / shard.file).resolve().parent != path.parent.resolve():
            raise DataError(
                f"{path.parent}: the shard {shard.file} lies in another folder; such links are not "
                "followed, since data from others could name any file: copy it there"
            )
    for clip in manifest.clips:
        has_shard = 0 <= clip.shard < len(manifest.shards)
        rows = manifest.shards[clip.shard].frames if has_shard else 0
        if not 0 < clip.frames <= rows or not 0 <= clip.offset <= clip.offset + clip.frames <= rows:
            raise DataError(f"{path}: clip {clip.id} lies outside its shard; prepare again")
        if clip.source == COMPOSED and clip.split != "train":
            raise DataError(
                f"{path}: synthetic clip {clip.id} is in the split {clip.split!r}, expected "
                "'train'; compose again"
            )
    return manifest


def write_dataset(
    folder: str | Path,
    motions: Iterable[StoredMotion],
    sources: tuple[Source, ...],
    representation: Representation,
    normalizer: StoredNormalizer,
    describe: Callable[[Path, DatasetManifest], object] = lambda *_: None,
) -> DatasetManifest:
    """Writes a prepared folder in place of what was there.

    Args:
        folder: The folder.
        motions: Its motions.
        sources: Their origins.
        representation: Features of the motions.
        normalizer: Statistics of the features.
        describe: Writes further files into the folder before it takes its place.

    Raises:
        DataError: There is no motion, or two have the same name.
        InputError: The folder cannot be written.
    """
    names: set[str] = set()
    groups: list[list[StoredMotion]] = []
    for motion in motions:
        if motion.clip.id in names:
            raise DataError(f"two clips are called {motion.clip.id!r}; rename one of them")
        names.add(motion.clip.id)
        frames = motion.clip.frames
        if not groups or sum(m.clip.frames for m in groups[-1]) + frames > SHARD_FRAMES:
            groups.append([])
        groups[-1].append(motion)
    if not groups:
        raise DataError("no clip is left to write; see the reasons in the report")
    with atomic_folder(folder, MANIFEST) as temporary:
        shards: list[Shard] = []
        clips: list[StoredClip] = []
        for number, group in enumerate(groups):
            path = temporary / f"motions-{number:03d}.safetensors"
            features = np.concatenate([motion.features for motion in group]).astype(np.float32)
            # Written here and not by safetensors, whose files only their owner may read.
            path.write_bytes(save({"features": features}))
            shards.append(Shard(path.name, len(features), sha256(path)))
            offset = 0
            for motion in group:
                clips.append(replace(motion.clip, shard=number, offset=offset))
                offset += motion.clip.frames
        manifest = DatasetManifest(
            format=FORMAT,
            representation=representation.name,
            fps=representation.fps,
            sources=sources,
            normalizer=normalizer,
            shards=tuple(shards),
            clips=tuple(clips),
        )
        write_json(temporary / MANIFEST, manifest)
        describe(temporary, manifest)
    return manifest


def stored_normalizer(normalizer: Normalizer, origin: str) -> StoredNormalizer:
    """Returns a normalizer as the manifest keeps it."""
    mean, std = (tuple(map(float, values)) for values in (normalizer.mean, normalizer.std))
    return StoredNormalizer(origin, mean, std)


def caption_rows(captions: Iterable[Caption]) -> tuple[CaptionRow, ...]:
    """Returns captions as the manifest keeps them."""
    return tuple((c.text, c.start_frame, c.end_frame, c.tokens) for c in captions)
