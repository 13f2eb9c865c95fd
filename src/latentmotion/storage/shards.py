"""Work in shards: files that any process may make, be killed at and make again, to the same bytes.

A shard is a file, which a function without arguments makes, or a table of further files. Beside it
is its record: size, hash and what was counted. The record is written last, so a shard with a record
is finished and is skipped. `run.json` says what the bytes follow from; who finds every shard
finished writes `manifest.json`. A file appears under its name only when it is complete.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from latentmotion.errors import DataError, InputError
from latentmotion.storage import configuration, reading
from latentmotion.storage.files import check_writable, remove_left, write_file


def folder_at(path: str | Path, create: bool = False) -> Path:
    """Returns the folder of a run, absolute.

    Args:
        path: The folder.
        create: Whether it is made where there is none.

    Raises:
        InputError: There is no such folder, or it cannot be made.
    """
    if "://" in str(path):
        raise InputError(f"{path} is an address; expected a folder, such as one that is mounted")
    folder = Path(path).absolute()
    if create:
        check_writable(folder)
        if not folder.is_file():
            folder.mkdir(exist_ok=True)
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; expected one that a run has written")
    return folder


RUN_FILE = "run.json"
MANIFEST_FILE = "manifest.json"


@dataclass(frozen=True)
class Wrong:
    """An item that could not be made."""

    line: int  # Its line in the file of items, counted from 1.
    problem: str  # What was found and what was expected.


@dataclass(frozen=True)
class ShardContent:
    """A shard as it is made."""

    content: bytes
    """The file."""
    items: int
    """Number of its items."""
    wrong: tuple[Wrong, ...] = ()
    """Items that it lacks."""
    files: Mapping[str, bytes] = field(default_factory=dict)
    """Further files that belong to it."""


@dataclass(frozen=True)
class FileRecord:
    """Record of a file."""

    name: str  # The file.
    size: int  # Its bytes.
    sha256: str  # Its SHA-256, as hexadecimal digits.


@dataclass(frozen=True)
class Record(FileRecord):
    """Record of a finished shard."""

    items: int  # Number of its items.
    wrong: tuple[Wrong, ...]  # Items that it lacks.
    run: str  # SHA-256 of the run's settings.
    files: tuple[FileRecord, ...] = ()  # Further files that belong to it.


@dataclass(frozen=True)
class ShardedRun:
    """Inputs that determine the bytes of all shards."""

    settings: Mapping[str, Any]
    """Plain values."""
    items: int
    """Number of items of all shards."""
    shards: tuple[str, ...]
    """The files."""

    @property
    def digest(self) -> str:
        """SHA-256 of the run, as hexadecimal digits."""
        return hashlib.sha256(_packed(self)).hexdigest()


@dataclass(frozen=True)
class ShardManifest:
    """A finished run."""

    run: ShardedRun  # Inputs that determine its bytes.
    shards: tuple[Record, ...]  # A record of each file.


@dataclass(frozen=True)
class ShardSubset:
    """One of several equal parts of the shards, such as 3/16; with others it covers all."""

    number: int = 1
    """From 1 up."""
    count: int = 1
    """Number of parts."""

    @classmethod
    def parse(cls, text: str) -> ShardSubset:
        """Returns the share that `3/16` names.

        Raises:
            InputError: It is no such text, or out of range.
        """
        match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
        if not match or not 1 <= int(match[1]) <= int(match[2]):
            raise InputError(f"shard {text!r}: expected a number of a total, such as 3/16")
        return cls(int(match[1]), int(match[2]))

    def of(self, names: Sequence[str]) -> Sequence[str]:
        """Returns the names of this share."""
        return names[self.number - 1 :: self.count]


@dataclass(frozen=True)
class Work:
    """A run and the functions that make its shards."""

    run: ShardedRun
    """What is made."""
    tasks: Mapping[str, Callable[[], ShardContent]] = field(repr=False)
    """A function for each file, which a worker's process can be sent."""


def make(
    work: Work,
    folder: Path,
    share: ShardSubset = ShardSubset(),
    report: Callable[[Record], object] = id,
) -> ShardManifest | None:
    """Makes the shards of a share in this process, all but finished ones.

    Args:
        work: The shards.
        folder: Where they are written.
        share: Which of them are made.
        report: Called with the record of each shard that is made.

    Returns:
        The manifest if all shards are finished, those of other shares too; else None.

    Raises:
        InputError: The folder holds another run, or cannot be written.
    """
    start(work.run, folder)
    there = _names(folder)
    for name in share.of(work.run.shards):
        if _record_of(name) not in there:
            report(finish(folder, name, work.tasks[name], work.run.digest))
    return conclude(work.run, folder)


def start(run: ShardedRun, folder: Path) -> None:
    """Writes `run.json` into a folder without one.

    Raises:
        InputError: The folder holds another run.
    """
    if RUN_FILE not in _names(folder):
        write_file(folder / RUN_FILE, _packed(run))
    existing = _read(ShardedRun, folder, RUN_FILE)
    if existing.digest == run.digest:
        return
    here, there = run.settings, existing.settings
    pairs = [
        f"{key} is {there.get(key)!r:.80} there, {here.get(key)!r:.80} here"
        for key in dict.fromkeys([*here, *there])
        if here.get(key) != there.get(key)
    ]
    if not pairs:
        pairs = [f"{len(existing.shards)} files there, {len(run.shards)} here"]
    raise InputError(
        f"{folder} holds another run: {', '.join(pairs)}; choose another folder or its settings"
    )


def finish(folder: Path, name: str, task: Callable[[], ShardContent], run: str) -> Record:
    """Makes a shard, writes its file and then its record, unless both are there.

    It may be killed at any time and be called again, at the same time too.

    Args:
        folder: Where it is written.
        name: Its file.
        task: Makes it.
        run: Digest of the run.

    Raises:
        InputError: It cannot be written.
    """
    if _record_of(name) in _names(folder):
        return _read(Record, folder, _record_of(name))
    shard = task()
    digest = hashlib.sha256(shard.content).hexdigest()
    further = tuple(
        FileRecord(file, len(content), hashlib.sha256(content).hexdigest())
        for file, content in shard.files.items()
    )
    record = Record(name, len(shard.content), digest, shard.items, shard.wrong, run, further)
    for file, content in shard.files.items():
        write_file(folder / file, content)
    write_file(folder / name, shard.content)
    write_file(folder / _record_of(name), _packed(record))
    return record


def conclude(run: ShardedRun, folder: Path) -> ShardManifest | None:
    """Writes the manifest once every shard is finished; before, returns None.

    Raises:
        DataError: A shard is of another run.
    """
    there = _names(folder)
    if not all(_record_of(name) in there for name in run.shards):
        return None
    records = tuple(_read(Record, folder, _record_of(name)) for name in run.shards)
    for record in records:
        if record.run != run.digest:
            raise DataError(f"{folder}: {record.name} is of another run; delete it and its record")
    # Whoever comes last writes it; if two do, both write the same bytes.
    manifest = ShardManifest(run, records)
    write_file(folder / MANIFEST_FILE, _packed(manifest))
    remove_left(folder)  # by killed writers
    return manifest


def check(folder: Path) -> ShardManifest:
    """Reads a finished run and compares every file with the manifest, byte by byte.

    Raises:
        DataError: A file is missing or differs, numbers do not add up, or the run is not finished.
    """
    there = _names(folder)
    if RUN_FILE not in there:
        raise DataError(f"{folder} holds no run: it has no {RUN_FILE}")
    if MANIFEST_FILE not in there:
        names = _read(ShardedRun, folder, RUN_FILE).shards
        missing = [name for name in names if _record_of(name) not in there]
        named = ", ".join(missing[:3]) + (", …" if len(missing) > 3 else "")
        problem = f"{len(missing)} of {len(names)} files are missing ({named}); run it again"
        raise DataError(f"{folder} is not finished: {problem}")
    manifest = _read(ShardManifest, folder, MANIFEST_FILE)
    if tuple(record.name for record in manifest.shards) != manifest.run.shards:
        raise DataError(f"{folder}: {MANIFEST_FILE} lists other files than its run; run it again")
    problems = []
    for record in (file for shard in manifest.shards for file in (shard, *shard.files)):
        if record.name not in there:
            problems.append(f"{record.name} is missing")
            continue
        content = reading.read_bytes(folder / record.name)
        if len(content) != record.size:
            size = f"{len(content):,} bytes, expected {record.size:,}"
            problems.append(f"{record.name} has {size}")
        elif hashlib.sha256(content).hexdigest() != record.sha256:
            problems.append(f"{record.name} has another content")
    if problems:
        more = f", and {len(problems) - 5} more" if len(problems) > 5 else ""
        raise DataError(
            f"{folder}: {', '.join(problems[:5])}{more}; delete these files and their records and "
            "run it again"
        )
    counted = sum(record.items + len(record.wrong) for record in manifest.shards)
    if counted != manifest.run.items:
        raise DataError(f"{folder}: {counted} items, expected {manifest.run.items}")
    return manifest


def _record_of(name: str) -> str:
    return f"{name}.json"


def _packed(value: ShardedRun | Record | ShardManifest) -> bytes:
    return (json.dumps(configuration.to_json(value), indent=1, ensure_ascii=False) + "\n").encode()


def _read(cls: type, folder: Path, name: str) -> Any:
    path = folder / name
    with reading.blamed_on(path):
        return configuration.from_json(cls, reading.parse_json(reading.read_bytes(path), path))


def _names(folder: Path) -> set[str]:
    """Returns the names of the files of a folder.

    Raises:
        InputError: It cannot be read.
    """
    try:
        return {entry.name for entry in folder.iterdir()}
    except OSError as error:
        advice = "check its path and permissions"
        raise InputError(f"cannot read the folder {folder}: {error.strerror}; {advice}") from error
