"""What a prepared folder says about itself: `manifest.json`, read strictly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion.data.clip import Caption, Clip, Source, Split
from latentmotion.errors import DataError, InputError
from latentmotion.storage.configuration import read_json

MANIFEST = "manifest.json"
FORMAT = "latentmotion dataset 1"

COMPOSED = "composed"
"""Source of synthetic sequences, which only train: a test set holds what people did."""

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
        if clip.source == COMPOSED and clip.split != "train":
            raise DataError(
                f"{path}: synthetic clip {clip.id} is in the split {clip.split!r}, expected "
                "'train'; compose again"
            )
