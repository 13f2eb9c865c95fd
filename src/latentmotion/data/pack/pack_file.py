"""The bytes of a pack: a head of fixed size, a header in JSON, one block of motions per shard.

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
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from latentmotion.data.prepare import Report
from latentmotion.data.store import FORMAT as DATASET_FORMAT
from latentmotion.data.store import Manifest
from latentmotion.errors import FileFormatError, InputError
from latentmotion.storage.configuration import from_json, to_json
from latentmotion.storage.files import atomic_file

FORMAT = "latentmotion pack 1"

_MAGIC = b"LMPACK1\n"
_HEAD = struct.Struct("<8s32sII")
_MOST_FILE = 1 << 30
_MOST_HEADER = 1 << 28
_MOST_MEMORY = 1 << 26
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9, "dict_size": 1 << 23, "lc": 0, "lp": 0, "pb": 0}]
"""Numbers have no alignment and no high bits in common, as these settings expect of text."""


@dataclass(frozen=True)
class PackHeader:
    """All of a pack but the motions themselves."""

    format: str
    """Name and version of the format."""
    quantum: float
    """Step of positions, meters."""
    turn_quantum: float
    """Step of the heading, radians."""
    manifest: Manifest
    """That of the prepared folder: sources and their terms, normalizer, clips, captions."""
    report: Report | None
    """The report of its preparation."""
    blocks: tuple[int, ...]
    """Bytes of each shard's motions in this file."""


@dataclass(frozen=True)
class PackFile:
    """A pack in memory, its hash compared, its motions still compressed."""

    path: Path
    """Where it was read."""
    header: PackHeader
    """Its header."""
    blocks: tuple[bytes, ...]
    """One per shard, compressed."""

    def motions(self, block: int, size: int) -> bytes:
        """Returns the motions of a shard.

        Args:
            block: Index of the shard.
            size: Bytes that they are expected to be.

        Raises:
            FileFormatError: They are not.
        """
        return _unpacked(self.path, f"block {block}", self.blocks[block], size)


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
    text = json.dumps(to_json(header), ensure_ascii=False, separators=(",", ":"))
    plain = text.encode()
    packed = lzma.compress(plain, preset=6)
    rest = struct.pack("<II", len(packed), len(plain)) + packed + b"".join(blocks)
    with atomic_file(path) as temporary:
        temporary.write_bytes(_MAGIC + hashlib.sha256(rest).digest() + rest)


def compressed(motions: bytes) -> bytes:
    """Returns the motions of one shard as a pack keeps them."""
    return lzma.compress(motions, format=lzma.FORMAT_XZ, filters=_FILTERS)


def read_pack(path: Path) -> PackFile:
    """Reads a pack; its motions are not unpacked yet.

    Raises:
        InputError: The file cannot be read.
        FileFormatError: It is no pack, of another version or damaged.
    """
    try:
        if (size := path.stat().st_size) > _MOST_FILE:
            raise FileFormatError(path, f"{size} bytes; a pack has at most {_MOST_FILE}")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: expected a data pack, cannot read it: {error.strerror}"
        ) from error
    if len(content) < _HEAD.size or not content.startswith(_MAGIC):
        raise FileFormatError(path, "no data pack; make one with `latentmotion data pack`")
    _, digest, packed, plain = _HEAD.unpack_from(content)
    if hashlib.sha256(content[40:]).digest() != digest:
        raise FileFormatError(path, "damaged or cut off (its hash differs); copy it again")
    if plain > _MOST_HEADER:
        raise FileFormatError(path, f"a header of {plain} bytes, at most {_MOST_HEADER} allowed")
    end = _HEAD.size + packed
    header = _header(path, _unpacked(path, "header", content[_HEAD.size : end], plain))
    if min(header.blocks, default=-1) < 0 or end + sum(header.blocks) != len(content):
        raise FileFormatError(path, "its blocks do not add up to its size; copy it again")
    blocks = []
    for size in header.blocks:
        blocks.append(content[end : end + size])
        end += size
    return PackFile(path, header, tuple(blocks))


def _header(path: Path, plain: bytes) -> PackHeader:
    try:
        data = json.loads(plain)
        found = data.get("format") if isinstance(data, dict) else None
        if found != FORMAT:
            raise InputError(f"format {found!r}, expected {FORMAT!r}; update latentmotion")
        header = from_json(PackHeader, data)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(path, f"its header is no JSON: {error}") from error
    except InputError as error:
        raise FileFormatError(path, f"its header: {error}") from error
    if header.manifest.format != DATASET_FORMAT:
        raise FileFormatError(path, f"holds {header.manifest.format!r}, not {DATASET_FORMAT!r}")
    return header


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
