"""Prepared folder → pack, verified by decoding it; pack → prepared folder."""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.dataset import Dataset
from latentmotion.data.pack.coding import MotionCoder, posed
from latentmotion.data.pack.pack_file import (
    FORMAT,
    PackFile,
    PackHeader,
    compressed,
    read_pack,
    write_pack,
)
from latentmotion.data.prepare import REPORT, read_report
from latentmotion.data.store import MANIFEST, Manifest, StoredClip, StoredMotion, write_dataset
from latentmotion.errors import DataError, FileFormatError, InputError
from latentmotion.representation.humanml3d import HumanML3DRepresentation
from latentmotion.representation.interface import representation_named
from latentmotion.representation.normalizer import Normalizer
from latentmotion.storage.cache_folder import VARIABLE, cache_folder
from latentmotion.storage.configuration import write_json
from latentmotion.storage.files import check_replaceable, check_writable, sha256

QUANTUM = 0.00025
"""Step of positions, meters."""

TURN_QUANTUM = 1 / 8192
"""Step of the heading, radians."""

_FURTHEST = 0.001
_MOST_FRAMES = 8_000_000
"""Feature frames of a pack, 111 hours at 20 a second."""
_QUANTA = 1e-6, 0.01


@dataclass
class Differences:
    """Differences between motions before and after packing."""

    joints_mm: float = 0.0
    """Largest distance of any joint in any frame, the heading and path included."""
    squares: dict[str, float] = field(default_factory=dict)
    """Sum of squared differences of normalized features by block."""
    contacts: int = 0
    """Contact labels that differ."""
    frames: int = 0
    """Feature frames that were compared."""


def pack(folder: Path, path: Path, quantum: float = QUANTUM) -> Differences:
    """Writes a prepared folder as one file.

    Args:
        folder: A prepared folder.
        path: File to write, replaced if it is there.
        quantum: Step of positions, meters.

    Raises:
        DataError: The folder is damaged, or its bodies have other bones than the skeleton.
        InputError: The file cannot be written, or the quantum is out of range.
    """
    check_writable(path)
    if not _QUANTA[0] <= quantum <= _QUANTA[1]:
        raise InputError(f"a quantum of {quantum:g} m; expected {_QUANTA[0]:g} to {_QUANTA[1]:g}")
    dataset = Dataset.load(folder)
    coder = MotionCoder(_packable(dataset.manifest.representation), quantum, TURN_QUANTUM)
    blocks, differences = [], Differences()
    for clips in _by_shard(dataset.manifest):
        features = [dataset.features(clip.clip()) for clip in clips]
        block = coder.encode(features)
        decoded = coder.decode(block, [clip.frames for clip in clips])
        for clip, before, after in zip(clips, features, decoded, strict=True):
            _compare(dataset, clip, before, after, differences)
        blocks.append(compressed(block))
    header = PackHeader(FORMAT, quantum, TURN_QUANTUM, dataset.manifest, read_report(folder), ())
    write_pack(path, header, blocks)
    return differences


def unpack(path: Path, folder: Path) -> Manifest:
    """Writes the prepared folder that a pack holds.

    Raises:
        DataError: The pack contradicts itself.
        FileFormatError: It is no pack, of another version or damaged.
        InputError: The folder cannot be written.
    """
    check_replaceable(folder, MANIFEST)
    opened = read_pack(path)
    coder = _checked(opened)
    manifest = opened.header.manifest
    motions = []
    for number, clips in enumerate(_by_shard(manifest)):
        frames = [clip.frames for clip in clips]
        block = opened.motions(number, coder.size(frames))
        for clip, features in zip(clips, coder.decode(block, frames), strict=True):
            if not np.isfinite(features).all():
                raise FileFormatError(path, f"clip {clip.id} is not finite; pack it again")
            motions.append(StoredMotion(replace(clip, shard=0, offset=0), features))
    written = write_dataset(
        folder, motions, manifest.sources, coder.representation, manifest.normalizer
    )
    if opened.header.report:
        write_json(folder / REPORT, opened.header.report)
    return written


def unpacked(path: Path) -> Path:
    """Returns the prepared folder that a pack holds, unpacked into the user's cache at first.

    Raises:
        DataError: The pack contradicts itself, or there is no cache.
        FileFormatError: It is no pack, of another version or damaged.
        InputError: The folder cannot be written.
    """
    cache = cache_folder()
    if cache is None:
        raise DataError(
            f"{path} is a file and {VARIABLE} is off; first: latentmotion data unpack {path}"
        )
    folder = cache / "data" / f"{path.stem}-{sha256(path)[:12]}"
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}")
        try:
            unpack(path, temporary)
            temporary.rename(folder)
        except OSError as error:  # another process was faster
            if not folder.is_dir():
                raise InputError(f"cannot write {folder}: {error.strerror}") from error
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    return folder


def _packable(name: str) -> HumanML3DRepresentation:
    representation = representation_named(name)
    if not isinstance(representation, HumanML3DRepresentation):
        raise DataError(f"features {name!r} cannot be packed; packs hold humanml3d and kit")
    return representation


def _by_shard(manifest: Manifest) -> Iterator[list[StoredClip]]:
    for shard in range(len(manifest.shards)):
        yield [clip for clip in manifest.clips if clip.shard == shard]


def _compare(
    dataset: Dataset,
    clip: StoredClip,
    before: Float[np.ndarray, "frames features"],
    after: Float[np.ndarray, "frames features"],
    differences: Differences,
) -> None:
    """Adds the differences of a clip; raises DataError if any joint is too far off."""
    representation = dataset.representation
    assert isinstance(representation, HumanML3DRepresentation)
    pair = (posed(features, representation)[0] for features in (before, after))
    furthest = float(np.linalg.norm(next(pair) - next(pair), axis=-1).max())
    if not furthest <= _FURTHEST:
        raise DataError(
            f"clip {clip.id} would be {1000 * furthest:.2f} mm off, more than 1: its bones are not "
            f"those of {representation.name}, or the quantum is too large"
        )
    differences.joints_mm = max(differences.joints_mm, 1000 * furthest)
    differences.frames += len(before)
    for name, block in representation.blocks.items():
        scaled = (before[:, block] - after[:, block]) / dataset.normalizer.std[block]
        square = float((scaled**2).sum()) / (block.stop - block.start)
        differences.squares[name] = differences.squares.get(name, 0.0) + square
    contacts = representation.blocks["contacts"]
    differences.contacts += int((before[:, contacts] != after[:, contacts]).sum())


def _checked(opened: PackFile) -> MotionCoder:
    """Returns the coder of a pack, whose header must not contradict itself."""
    header, manifest = opened.header, opened.header.manifest
    mean, std = (np.array(v) for v in (manifest.normalizer.mean, manifest.normalizer.std))
    try:
        representation = _packable(manifest.representation)
        if mean.shape != (representation.width,) or std.shape != mean.shape:
            raise InputError(f"a normalizer that is not of {representation.width} numbers")
        Normalizer(mean, std)
    except (DataError, InputError) as error:
        raise FileFormatError(opened.path, f"{error}; update latentmotion or pack again") from error
    quanta = header.quantum, header.turn_quantum
    consistent = [
        all(_QUANTA[0] <= value <= _QUANTA[1] for value in quanta),
        len(header.blocks) == len(manifest.shards) > 0,
        all(0 <= clip.shard < len(manifest.shards) for clip in manifest.clips),
        all(clip.frames > 0 for clip in manifest.clips),
        sum(clip.frames for clip in manifest.clips) <= _MOST_FRAMES,
        all(_by_shard(manifest)),
    ]
    if not all(consistent):
        raise FileFormatError(opened.path, "its header contradicts itself; pack it again")
    return MotionCoder(representation, *quanta)
