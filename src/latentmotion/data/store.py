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

from latentmotion.data.clip import Caption, Source
from latentmotion.data.manifest import (
    FORMAT,
    MANIFEST,
    CaptionRow,
    Manifest,
    Shard,
    StoredClip,
    StoredNormalizer,
)
from latentmotion.errors import DataError
from latentmotion.representation.interface import Representation
from latentmotion.representation.normalizer import Normalizer
from latentmotion.storage.configuration import write_json
from latentmotion.storage.files import atomic_folder, sha256

SHARD_FRAMES = 40_000
"""Frames after which a new shard begins: some 40 MB, which every host takes."""


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
    motions = _unique(motions)
    with atomic_folder(folder, MANIFEST) as temporary:
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


def stored_normalizer(normalizer: Normalizer, origin: str) -> StoredNormalizer:
    """Returns what the manifest keeps of a normalizer."""
    mean, std = (tuple(map(float, values)) for values in (normalizer.mean, normalizer.std))
    return StoredNormalizer(origin, mean, std)


def caption_rows(captions: Iterable[Caption]) -> tuple[CaptionRow, ...]:
    """Returns captions as the manifest keeps them."""
    return tuple((c.text, c.start_frame, c.end_frame, c.tokens) for c in captions)


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
