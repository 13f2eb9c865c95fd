"""A prepared folder in Python: clips by split, their features, normalizer and sources."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError, safe_open

from latentmotion.data.clip import SPLITS, Clip, Source
from latentmotion.data.store import MANIFEST, Manifest, StoredClip, read_manifest
from latentmotion.errors import DataError, InputError
from latentmotion.representation.interface import Representation, representation_named
from latentmotion.representation.normalizer import Normalizer
from latentmotion.storage.files import sha256


@dataclass(frozen=True, eq=False)
class Dataset:
    """Motions ready for training; features are read from disk on demand."""

    folder: Path
    """The prepared folder."""
    manifest: Manifest
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
            # Looked up only here: packs are made of data sets.
            from latentmotion.data.pack.packing import unpacked

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
        stored = self.manifest.normalizer
        with np.errstate(over="ignore"):
            mean, std = (np.array(values, np.float32) for values in (stored.mean, stored.std))
        width = self.representation.width
        if mean.shape != (width,) or std.shape != (width,):
            raise DataError(
                f"{self.folder}: a normalizer of {len(mean)} and {len(std)} numbers, expected "
                f"{width}; prepare the folder again"
            )
        try:
            return Normalizer(mean, std)
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
        if split not in SPLITS:
            raise DataError(f"unknown split {split!r}, known are {', '.join(SPLITS)}")
        sides = (False, True) if mirrored else (False,)
        stored = (clip for clip in self.manifest.clips if clip.split == split)
        return [clip.clip(side) for clip in stored for side in sides]

    def features(self, clip: Clip) -> Float[np.ndarray, "frames features"]:
        """Returns the features of a clip, not normalized, float32.

        Raises:
            DataError: The clip is not in this folder, or its shard is damaged.
        """
        name = clip.id.removeprefix("M") if clip.mirrored else clip.id
        if name not in self._stored:
            raise DataError(f"{self.folder} has no clip {clip.id!r}")
        stored = self._stored[name]
        shard = self.manifest.shards[stored.shard]
        path, expected = self.folder / shard.file, [shard.frames, self.representation.width]
        try:
            with safe_open(path, "np") as opened:
                rows = opened.get_slice("features")
                if rows.get_dtype() != "F32" or rows.get_shape() != expected:
                    found = f"features {rows.get_shape()} of {rows.get_dtype()}"
                    raise DataError(
                        f"{path}: {found}, expected {expected} of F32; prepare it again"
                    )
                features = rows[stored.offset : stored.offset + stored.frames]
        except (OSError, SafetensorError) as error:
            raise DataError(f"{path} is damaged ({error}); copy or prepare it again") from error
        if not np.isfinite(features).all():
            raise DataError(
                f"{path}: clip {clip.id} holds NaN or infinity; copy or prepare it again"
            )
        return self.representation.mirror(features) if clip.mirrored else features

    def actions(self) -> list[str]:
        """Returns the action labels that occur, sorted."""
        return sorted({clip.action for clip in self.manifest.clips if clip.action})

    @cached_property
    def _stored(self) -> dict[str, StoredClip]:
        return {clip.id: clip for clip in self.manifest.clips}
