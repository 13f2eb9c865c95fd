"""Prepared folder → pack, verified by decoding it; preparation of sources in shards.

A shard holds the features of its recordings as they were computed, and all else about them as JSON.
What is prepared from the shards is, to the byte, what one process prepares from the files.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load, save

from latentmotion.data import pack_file
from latentmotion.data.dataset import Dataset
from latentmotion.data.pack_coding import MotionCoder, posed
from latentmotion.data.pack_file import QUANTA, QUANTUM, TURN_QUANTUM
from latentmotion.data.prepare import encode_all
from latentmotion.data.recording import Dropped, EncodedRecording, FileGroup, Label
from latentmotion.data.report import read_report
from latentmotion.errors import DataError, InputError
from latentmotion.representation.interface import Representation
from latentmotion.storage import files, shards
from latentmotion.storage.configuration import from_json, to_json
from latentmotion.storage.reading import blamed_on, parse_json

# Meters that a joint may be off after packing.
_FURTHEST = 0.001


@dataclass
class Differences:
    """Differences between motions before and after packing."""

    # Largest distance of any joint in any frame, the heading and path included.
    joints_mm: float = 0.0
    # Sum of squared differences of normalized features by block.
    squares: dict[str, float] = field(default_factory=dict)
    contacts: int = 0  # Contact labels that differ.
    frames: int = 0  # Feature frames that were compared.


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
    files.check_writable(path)
    if not QUANTA[0] <= quantum <= QUANTA[1]:
        raise InputError(f"a quantum of {quantum:g} m; expected {QUANTA[0]:g} to {QUANTA[1]:g}")
    dataset = Dataset.load(folder)
    representation = pack_file.packable(dataset.manifest.representation)
    coder = MotionCoder(representation, quantum, TURN_QUANTUM)
    blocks, differences = [], Differences()
    for clips in pack_file.clips_by_shard(dataset.manifest):
        features = [dataset.features(clip.clip()) for clip in clips]
        block = coder.encode(features)
        decoded = coder.decode(block, [clip.frames for clip in clips])
        for clip, before, after in zip(clips, features, decoded, strict=True):
            pair = (posed(each, representation)[0] for each in (before, after))
            furthest = float(np.linalg.norm(next(pair) - next(pair), axis=-1).max())
            if not furthest <= _FURTHEST:
                raise DataError(
                    f"clip {clip.id} would be {1000 * furthest:.2f} mm off, more than 1: its bones "
                    f"are not those of {representation.name}, or the quantum is too large"
                )
            differences.joints_mm = max(differences.joints_mm, 1000 * furthest)
            differences.frames += len(before)
            for name, columns in representation.blocks.items():
                scaled = (before[:, columns] - after[:, columns]) / dataset.normalizer.std[columns]
                square = float((scaled**2).sum()) / (columns.stop - columns.start)
                differences.squares[name] = differences.squares.get(name, 0.0) + square
            contacts = representation.blocks["contacts"]
            differences.contacts += int((before[:, contacts] != after[:, contacts]).sum())
        blocks.append(pack_file.compressed(block))
    header = pack_file.PackHeader(
        pack_file.FORMAT, quantum, TURN_QUANTUM, dataset.manifest, read_report(folder), ()
    )
    pack_file.write_pack(path, header, blocks)
    return differences


FILES = 32  # Files of a shard: a killed process loses the work on so many at most.

_ABOUT = "about"


def work_of(
    groups: Sequence[FileGroup], representation: Representation, settings: Mapping[str, Any]
) -> shards.Work:
    """Returns groups of files as shards.

    Args:
        groups: The files.
        representation: Representation of the features.
        settings: Plain values on which it depends how they are read.
    """
    files = [path for group in groups for path in group.files]
    sizes = "\n".join(f"{path.name} {path.stat().st_size}" for path in files)
    about = {
        "representation": representation.name,
        **settings,
        "names and sizes": hashlib.sha256(sizes.encode(errors="surrogateescape")).hexdigest(),
    }
    tasks = {
        f"recordings-{number:05d}.safetensors": partial(_shard, group, representation)
        for number, group in enumerate(groups)
    }
    return shards.Work(shards.ShardedRun(about, len(files), tuple(tasks)), tasks)


def recordings_of(folder: Path) -> Iterator[EncodedRecording | Dropped]:
    """Yields what finished shards hold, in the order of the files.

    Raises:
        DataError: A shard is missing or damaged.
    """
    for record in shards.check(folder).shards:
        path = folder / record.name
        arrays = load(path.read_bytes())
        with blamed_on(path):
            for number, item in enumerate(parse_json(arrays[_ABOUT].tobytes(), path)):
                if item["kind"] == Dropped.__name__:
                    yield from_json(Dropped, item)
                    continue
                label = from_json(Label, item["label"])
                yield EncodedRecording(label, arrays[str(number)], item["round_trip_mm"])


def _shard(group: FileGroup, representation: Representation) -> shards.ShardContent:
    items = list(encode_all(group.read(), representation))
    arrays: dict[str, np.ndarray] = {}
    items_json = []
    for number, item in enumerate(items):
        if isinstance(item, EncodedRecording):
            arrays[str(number)] = np.ascontiguousarray(item.features)
            item = {"kind": "", "label": to_json(item.label), "round_trip_mm": item.round_trip_mm}
        items_json.append(to_json(item))
    arrays[_ABOUT] = np.frombuffer(json.dumps(items_json).encode(), np.uint8)
    return shards.ShardContent(save(arrays), len(group.files))
