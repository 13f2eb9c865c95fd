"""Preparation in shards: groups of files, each encoded by itself and kept beside the output folder.

A shard holds the features of its recordings as they were computed, and all else about them as JSON.
What is prepared from the shards is, to the byte, what one process prepares from the files.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from safetensors.numpy import load, save

from latentmotion.data.prepare import encode_all
from latentmotion.data.recording import Dropped, EncodedRecording, FileGroup, Label
from latentmotion.representation.interface import Representation
from latentmotion.storage import shards
from latentmotion.storage.address import Folder
from latentmotion.storage.configuration import from_json, to_json
from latentmotion.storage.reading import blamed_on, parse_json

FILES = 32
"""Files of a shard: a killed process loses the work on so many at most."""

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
    return shards.Work(shards.Run(about, len(files), tuple(tasks)), tasks)


def recordings_of(folder: Folder) -> Iterator[EncodedRecording | Dropped]:
    """Yields what finished shards hold, in the order of the files.

    Raises:
        DataError: A shard is missing or damaged.
    """
    for record in shards.check(folder).shards:
        path = f"{folder}/{record.name}"
        arrays = load(folder.read(record.name))
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
