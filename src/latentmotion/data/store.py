"""The prepared folder: `manifest.json` and `motions-NNN.safetensors`, written whole or not at all.

A shard holds one array `features` (frames, features), float32, not normalized: its clips one after
another, each stored once. Mirrored copies are computed when they are read.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from safetensors.numpy import save

from latentmotion.configuration import read_json, write_json
from latentmotion.data.clip import Caption, Clip, Source, Split
from latentmotion.errors import DataError, InputError
from latentmotion.files import atomic_folder, sha256
from latentmotion.representation.interface import Representation
from latentmotion.representation.normalizer import Normalizer

MANIFEST = "manifest.json"
FORMAT = "latentmotion dataset 1"
SHARD_FRAMES = 40_000
"""Frames after which a new shard begins: some 40 MB, which every host takes."""

CaptionRow = tuple[str, int, int, str]
"""Text, first frame, one past the last frame, tokens."""


@dataclass(frozen=True)
class StoredClip:
    """Where a clip lies and all that is known about it and its mirror image."""

    id: str
    """Unique name."""
    source: str
    """Name of its source."""
    origin: str
    """The recording that it was cut from and where."""
    split: Split
    """The part of the data that it belongs to."""
    frames: int
    """Number of feature frames."""
    shard: int
    """Index of the shard that holds it."""
    offset: int
    """Its first row there."""
    captions: tuple[CaptionRow, ...]
    """Sentences about it."""
    mirrored_captions: tuple[CaptionRow, ...]
    """Sentences about its mirror image."""
    action: str | None = None
    """Action label."""
    mirrored_action: str | None = None
    """Action label of its mirror image."""

    def clip(self, mirrored: bool = False) -> Clip:
        """Returns the clip, or its mirrored copy."""
        rows = self.mirrored_captions if mirrored else self.captions
        return Clip(
            id=f"M{self.id}" if mirrored else self.id,
            source=self.source,
            split=self.split,
            captions=tuple(Caption(*row) for row in rows),
            action=self.mirrored_action if mirrored else self.action,
            mirrored=mirrored,
            frames=self.frames,
            origin=self.origin,
        )


@dataclass(frozen=True)
class Shard:
    """One file of features."""

    file: str
    """Its name in the folder."""
    frames: int
    """Number of rows."""
    sha256: str
    """Hash of the file."""


@dataclass(frozen=True)
class StoredNormalizer:
    """Mean and standard deviation by which features are normalized."""

    origin: str
    """What they were computed from."""
    mean: tuple[float, ...]
    """One per feature."""
    std: tuple[float, ...]
    """One per feature."""


@dataclass(frozen=True)
class Manifest:
    """Everything about a prepared folder but the features themselves."""

    format: str
    """Which version of the format this is."""
    representation: str
    """Name of the representation of the features."""
    fps: float
    """Frames per second."""
    sources: tuple[Source, ...]
    """Where the motions come from and what their owners ask."""
    normalizer: StoredNormalizer
    """How features are normalized."""
    shards: tuple[Shard, ...]
    """Files of features."""
    clips: tuple[StoredClip, ...]
    """Clips, in the order in which they lie in the shards."""


@dataclass(frozen=True, eq=False)
class StoredMotion:
    """A clip on its way into a folder; its place there (shard and offset) is not yet known."""

    clip: StoredClip
    """What is known about it."""
    features: Float[np.ndarray, "frames features"]
    """Features, not normalized."""


def write_dataset(
    folder: str | Path,
    motions: Iterable[StoredMotion],
    sources: tuple[Source, ...],
    representation: Representation,
    normalizer: StoredNormalizer,
) -> Manifest:
    """Writes a prepared folder in place of what was there.

    Raises:
        DataError: There is no motion, or two have the same name.
        InputError: The folder cannot be written.
    """
    check_target(folder)
    motions = _unique(motions)
    with atomic_folder(folder) as temporary:
        shards: list[Shard] = []
        clips: list[StoredClip] = []
        for number, group in enumerate(_in_shards(motions)):
            shards.append(_write_shard(temporary, number, group))
            clips.extend(_placed(group, number))
        manifest = Manifest(
            format=FORMAT,
            representation=representation.name,
            fps=representation.fps,
            sources=sources,
            normalizer=normalizer,
            shards=tuple(shards),
            clips=tuple(clips),
        )
        write_json(temporary / MANIFEST, manifest)
    return manifest


def check_target(folder: str | Path) -> None:
    """Refuses to write where it cannot, or in place of anything but a prepared folder.

    Raises:
        InputError: The parent does not exist, or the folder holds something else.
    """
    folder = Path(folder)
    if not folder.absolute().parent.is_dir():
        raise InputError(f"cannot write {folder}: {folder.absolute().parent} does not exist")
    is_other = folder.is_file() or (folder.is_dir() and any(folder.iterdir()))
    if is_other and not (folder / MANIFEST).is_file():
        raise InputError(f"{folder} exists and is no prepared data set; choose another folder")


def read_manifest(folder: str | Path) -> Manifest:
    """Reads what a prepared folder says about itself.

    Raises:
        DataError: The folder is not a prepared one, or it is damaged.
    """
    path = Path(folder) / MANIFEST
    if not path.is_file():
        found = "a folder without it" if path.parent.is_dir() else "no such folder"
        raise DataError(
            f"{folder}: expected a prepared data set ({MANIFEST}), found {found}; "
            "make one with `latentmotion data prepare`"
        )
    try:
        manifest = read_json(Manifest, path)
    except InputError as error:
        raise DataError(f"{error}; prepare the folder again") from error
    _check_manifest(path, manifest)
    return manifest


def stored_normalizer(normalizer: Normalizer, origin: str) -> StoredNormalizer:
    """Returns what the manifest keeps of a normalizer."""
    mean, std = (tuple(map(float, values)) for values in (normalizer.mean, normalizer.std))
    return StoredNormalizer(origin, mean, std)


def caption_rows(captions: Iterable[Caption]) -> tuple[CaptionRow, ...]:
    """Returns captions as the manifest keeps them."""
    return tuple((c.text, c.start_frame, c.end_frame, c.tokens) for c in captions)


def _check_manifest(path: Path, manifest: Manifest) -> None:
    if manifest.format != FORMAT:
        raise DataError(
            f"{path}: expected format {FORMAT!r}, found {manifest.format!r}; prepare it again"
        )
    for shard in manifest.shards:
        if not (path.parent / shard.file).is_file():
            raise DataError(f"{path.parent}: lacks {shard.file}; copy it there or prepare again")
    for clip in manifest.clips:
        rows = manifest.shards[clip.shard].frames if clip.shard < len(manifest.shards) else 0
        if not 0 <= clip.offset <= clip.offset + clip.frames <= rows:
            raise DataError(f"{path}: clip {clip.id} lies outside its shard; prepare again")


def _unique(motions: Iterable[StoredMotion]) -> list[StoredMotion]:
    found: dict[str, StoredMotion] = {}
    for motion in motions:
        if motion.clip.id in found:
            raise DataError(f"two clips are called {motion.clip.id!r}; rename one of them")
        found[motion.clip.id] = motion
    if not found:
        raise DataError("no clip is left to write; see the reasons in the report")
    return list(found.values())


def _in_shards(motions: list[StoredMotion]) -> Iterator[list[StoredMotion]]:
    group: list[StoredMotion] = []
    for motion in motions:
        if group and sum(m.clip.frames for m in group) + motion.clip.frames > SHARD_FRAMES:
            yield group
            group = []
        group.append(motion)
    yield group


def _write_shard(folder: Path, number: int, group: list[StoredMotion]) -> Shard:
    path = folder / f"motions-{number:03d}.safetensors"
    features = np.concatenate([motion.features for motion in group]).astype(np.float32)
    # Written here and not by safetensors, whose files only their owner may read.
    path.write_bytes(save({"features": features}))
    return Shard(path.name, len(features), sha256(path))


def _placed(group: list[StoredMotion], shard: int) -> Iterator[StoredClip]:
    offset = 0
    for motion in group:
        fields: dict[str, Any] = vars(motion.clip) | {"shard": shard, "offset": offset}
        yield StoredClip(**fields)
        offset += motion.clip.frames
