"""Packs: one file that holds a prepared folder, read, written and unpacked.

    8   LMPACK1 and a line feed
    32  SHA-256 of all that follows
    8   bytes of the header as it lies here, and unpacked (two unsigned 32-bit, little-endian)
    ..  header, then the blocks; each is an xz stream

Nothing is unpacked before its size is known and within limits, nor beyond that size.
"""

from __future__ import annotations

import hashlib
import json
import lzma
import secrets
import shutil
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from pathlib import Path

import numpy as np

from latentmotion.data import store
from latentmotion.data.pack_coding import MotionCoder
from latentmotion.data.report import REPORT, PreparationReport
from latentmotion.errors import DataError, FileFormatError, InputError, unreadable
from latentmotion.representation import representation_named
from latentmotion.representation.humanml3d import HumanML3DRepresentation
from latentmotion.storage import files
from latentmotion.storage.configuration import from_json, to_json, write_json

FORMAT = "latentmotion pack 1"

_MAGIC = b"LMPACK1\n"
_HEAD = struct.Struct("<8s32sII")
_MOST_FILE = 1 << 30
_MOST_HEADER = 1 << 28
_MOST_MEMORY = 1 << 26
# Numbers have no alignment and no high bits in common, as these settings expect of text.
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9, "dict_size": 1 << 23, "lc": 0, "lp": 0, "pb": 0}]


@dataclass(frozen=True)
class PackHeader:
    """All of a pack but the motions themselves."""

    format: str  # Name and version of the format.
    quantum: float  # Step of positions, meters.
    turn_quantum: float  # Step of the heading, radians.
    # That of the prepared folder: sources and their terms, normalizer, clips, captions.
    manifest: store.DatasetManifest
    report: PreparationReport | None  # The report of its preparation.
    blocks: tuple[int, ...]  # Bytes of each shard's motions in this file.


def write_pack(path: Path, header: PackHeader, blocks: Sequence[bytes]) -> None:
    """Writes a pack in place of what was there.

    Args:
        path: The file.
        header: Its header; `blocks` of it is filled in here.
        blocks: The motions of each shard as `compressed` returns them.

    Raises:
        InputError: The file cannot be written.
    """
    header = replace(header, blocks=tuple(len(block) for block in blocks))
    plain = json.dumps(to_json(header), ensure_ascii=False, separators=(",", ":")).encode()
    packed = lzma.compress(plain, preset=6 | lzma.PRESET_EXTREME)  # 3 % smaller
    rest = struct.pack("<II", len(packed), len(plain)) + packed + b"".join(blocks)
    with files.atomic_file(path) as temporary:
        temporary.write_bytes(_MAGIC + hashlib.sha256(rest).digest() + rest)


def compressed(motions: bytes) -> bytes:
    """Returns the motions of one shard as a pack keeps them."""
    return lzma.compress(motions, format=lzma.FORMAT_XZ, filters=_FILTERS)


def read_pack(path: Path) -> tuple[PackHeader, list[bytes]]:
    """Returns the header of a pack and the motions of each shard, still compressed.

    Raises:
        InputError: The file cannot be read.
        FileFormatError: It is no pack, of another version or damaged.
    """
    try:
        if (size := path.stat().st_size) > _MOST_FILE:
            raise FileFormatError(path, f"{size} bytes; a pack has at most {_MOST_FILE}")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: no data pack, it cannot be read: {unreadable(error)}") from error
    if len(content) < _HEAD.size or not content.startswith(_MAGIC):
        raise FileFormatError(path, "no data pack; make one with `latentmotion data pack`")
    _, digest, packed, plain = _HEAD.unpack_from(content)
    if hashlib.sha256(content[40:]).digest() != digest:
        raise FileFormatError(path, "damaged or cut off (its hash differs); copy it again")
    if plain > _MOST_HEADER:
        raise FileFormatError(path, f"a header of {plain} bytes, at most {_MOST_HEADER} allowed")
    end = _HEAD.size + packed
    text = _unpacked(path, "header", content[_HEAD.size : end], plain)
    try:
        data = json.loads(text)
        version = data.get("format") if isinstance(data, dict) else None
        if version != FORMAT:
            raise InputError(f"format {version!r}, expected {FORMAT!r}; update latentmotion")
        header = from_json(PackHeader, data)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(path, f"its header is no JSON: {error}") from error
    except InputError as error:
        raise FileFormatError(path, f"its header: {error}") from error
    if header.manifest.format != store.FORMAT:
        raise FileFormatError(path, f"holds {header.manifest.format!r}, not {store.FORMAT!r}")
    if min(header.blocks, default=-1) < 0 or end + sum(header.blocks) != len(content):
        raise FileFormatError(path, "its blocks do not add up to its size; copy it again")
    return header, [content[a:b] for a, b in pairwise(accumulate(header.blocks, initial=end))]


def _unpacked(path: Path, what: str, packed: bytes, size: int) -> bytes:
    decompressor = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_MOST_MEMORY)
    try:
        plain = decompressor.decompress(packed, max_length=size)
        complete = decompressor.eof or not decompressor.decompress(b"", max_length=1)
    except (lzma.LZMAError, EOFError) as error:
        raise FileFormatError(path, f"{what} cannot be unpacked: {error}") from error
    if len(plain) != size or not complete or not decompressor.eof:
        raise FileFormatError(path, f"{what} is not of the {size} bytes that were announced")
    return plain


QUANTUM = 0.00025  # Step of positions, meters.

TURN_QUANTUM = 1 / 8192  # Step of the heading, radians.

# Feature frames of a pack, 111 hours at 20 a second.
_MOST_FRAMES = 8_000_000
QUANTA = 1e-6, 0.01  # Least and greatest step of positions and heading that a pack may have.


def unpack(path: Path, folder: Path) -> store.DatasetManifest:
    """Writes the prepared folder that a pack holds.

    Raises:
        DataError: The pack contradicts itself.
        FileFormatError: It is no pack, of another version or damaged.
        InputError: The folder cannot be written.
    """
    files.check_replaceable(folder, store.MANIFEST)
    header, blocks = read_pack(path)
    coder, manifest = _checked(path, header), header.manifest
    motions = []
    for number, clips in enumerate(clips_by_shard(manifest)):
        frames = [clip.frames for clip in clips]
        block = _unpacked(path, f"block {number}", blocks[number], coder.size(frames))
        for clip, features in zip(clips, coder.decode(block, frames), strict=True):
            if not np.isfinite(features).all():
                raise FileFormatError(path, f"clip {clip.id} is not finite; pack it again")
            motions.append(store.StoredMotion(replace(clip, shard=0, offset=0), features))
    written = store.write_dataset(
        folder, motions, manifest.sources, coder.representation, manifest.normalizer
    )
    if header.report:
        write_json(folder / REPORT, header.report)
    return written


def unpacked(path: Path) -> Path:
    """Returns the prepared folder that a pack holds, unpacked into the user's cache at first.

    Raises:
        DataError: The pack contradicts itself, or there is no cache.
        FileFormatError: It is no pack, of another version or damaged.
        InputError: The folder cannot be written.
    """
    cache = files.cache_folder()
    if cache is None:
        raise DataError(
            f"{path} is a file and {files.VARIABLE} is off; first: latentmotion data unpack {path}"
        )
    folder = cache / "data" / f"{path.stem}-{files.sha256(path)[:12]}"
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


def packable(name: str) -> HumanML3DRepresentation:
    """Returns the representation of that name.

    Raises:
        DataError: Its features cannot be packed.
    """
    representation = representation_named(name)
    if not isinstance(representation, HumanML3DRepresentation):
        raise DataError(f"features {name!r} cannot be packed; packs hold humanml3d and kit")
    return representation


def clips_by_shard(manifest: store.DatasetManifest) -> Iterator[list[store.StoredClip]]:
    """Yields the clips of each shard, which are one block of a pack."""
    for shard in range(len(manifest.shards)):
        yield [clip for clip in manifest.clips if clip.shard == shard]


def _checked(path: Path, header: PackHeader) -> MotionCoder:
    """Returns the coder of a pack, whose header must not contradict itself."""
    manifest = header.manifest
    try:
        representation = packable(manifest.representation)
        manifest.normalizer.opened(representation.width)
    except (DataError, InputError) as error:
        raise FileFormatError(path, f"{error}; update latentmotion or pack again") from error
    quanta = header.quantum, header.turn_quantum
    consistent = [
        all(QUANTA[0] <= value <= QUANTA[1] for value in quanta),
        len(header.blocks) == len(manifest.shards) > 0,
        all(0 <= clip.shard < len(manifest.shards) for clip in manifest.clips),
        all(clip.frames > 0 for clip in manifest.clips),
        sum(clip.frames for clip in manifest.clips) <= _MOST_FRAMES,
        all(clips_by_shard(manifest)),
    ]
    if not all(consistent):
        raise FileFormatError(path, "its header contradicts itself; pack it again")
    return MotionCoder(representation, *quanta)
