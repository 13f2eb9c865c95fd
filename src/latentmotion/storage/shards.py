"""Work in shards: files that any process may make, be killed at and make again, to the same bytes.

A shard is a file, which a function without arguments makes, or a table of further files. Beside it
is its record: size, hash and
what was counted. The record is written last, so a shard with a record is finished and is skipped.
`run.json` says what the bytes follow from; who finds every shard finished writes `manifest.json`.

Folders at an address: a local path, or a URL of any file system that fsspec knows.

A file appears under its name only when it is complete: it is written under another name first and
then renamed.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from latentmotion.errors import DataError, InputError, MissingExtraError
from latentmotion.storage.configuration import from_json, to_json
from latentmotion.storage.files import check_writable, remove_left, write_file
from latentmotion.storage.reading import blamed_on, parse_json, read_bytes

_PART = ".part"


@dataclass(frozen=True)
class LocalFolder:
    """A folder of this machine."""

    path: Path  # The folder, absolute.

    def __str__(self) -> str:
        return str(self.path)

    def names(self) -> set[str]:
        """Returns the names of its files.

        Raises:
            InputError: It cannot be read.
        """
        try:
            return {entry.name for entry in self.path.iterdir()}
        except OSError as error:
            advice = "check its path and permissions"
            raise InputError(
                f"cannot read the folder {self.path}: {error.strerror}; {advice}"
            ) from error

    def read(self, name: str) -> bytes:
        """Returns the content of a file."""
        return read_bytes(self.path / name)

    def write(self, name: str, content: bytes) -> None:
        """Writes a file, or replaces it.

        Raises:
            InputError: It cannot be written.
        """
        write_file(self.path / name, content)

    def tidy(self) -> None:
        """Removes what killed writers left."""
        remove_left(self.path)


@dataclass(frozen=True)
class RemoteFolder:
    """A folder of a file system of fsspec. It can be pickled, as workers need."""

    url: str  # Address of the folder, for messages.
    system: Any  # fsspec's file system.
    path: str  # Path of the folder in it.

    def __str__(self) -> str:
        return self.url

    def names(self) -> set[str]:
        """Returns the names of its files."""
        with self._remote_errors():
            # Other processes write here, too, and fsspec lists a folder once.
            self.system.invalidate_cache()
            return {entry.rsplit("/", 1)[-1] for entry in self.system.ls(self.path, detail=False)}

    def read(self, name: str) -> bytes:
        """Returns the content of a file."""
        with self._remote_errors():
            return self.system.cat_file(f"{self.path}/{name}")

    def write(self, name: str, content: bytes) -> None:
        """Writes a file, or replaces it."""
        # The name is the same each time, so that what a killed process left is written over.
        temporary, target = f"{self.path}/.{name}{_PART}", f"{self.path}/{name}"
        with self._remote_errors():
            self.system.pipe_file(temporary, content)
            try:
                self.system.mv(temporary, target)
            except FileNotFoundError:  # another process wrote the same file and was faster
                if not self.system.exists(target):
                    raise

    def tidy(self) -> None:
        """Removes files that killed writers left; only safe while nobody writes."""
        for name in self.names():
            if name.startswith(".") and name.endswith(_PART):
                with suppress(OSError):  # who writes the same file was faster
                    self.system.rm_file(f"{self.path}/{name}")

    @contextmanager
    def _remote_errors(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # each file system has error classes of its own
            raise InputError(f"cannot use {self.url}: {error!s:.300}") from error


Folder = LocalFolder | RemoteFolder  # A folder of files that are written and read as a whole.


def folder_at(address: str, create: bool = False) -> Folder:
    """Returns the folder at an address.

    Args:
        address: A local path, or a URL such as `s3://bucket/motions`.
        create: Whether the folder is made where there is none.

    Raises:
        InputError: There is no such folder, or the file system cannot be reached.
        MissingExtraError: It is a URL and fsspec is not installed.
    """
    if "://" not in address:
        path = Path(address).absolute()
        if create:
            check_writable(path)
            if not path.is_file():
                path.mkdir(exist_ok=True)
        if not path.is_dir():
            raise InputError(f"{path} is no folder; expected one that a run has written")
        return LocalFolder(path)
    try:
        from fsspec.core import url_to_fs
    except ModuleNotFoundError as error:
        raise MissingExtraError(f"the address {address}", "fsspec", "bulk") from error
    try:
        system, path = url_to_fs(address)
        if create:
            system.makedirs(path, exist_ok=True)
    except Exception as error:  # each file system has error classes of its own
        raise InputError(f"cannot use {address}: {error!s:.300}") from error
    return RemoteFolder(address, system, path.rstrip("/"))


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
    folder: Folder,
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
    there = folder.names()
    for name in share.of(work.run.shards):
        if _record_of(name) not in there:
            report(finish(folder, name, work.tasks[name], work.run.digest))
    return conclude(work.run, folder)


def start(run: ShardedRun, folder: Folder) -> None:
    """Writes `run.json` into a folder without one.

    Raises:
        InputError: The folder holds another run.
    """
    if RUN_FILE not in folder.names():
        folder.write(RUN_FILE, _packed(run))
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


def finish(folder: Folder, name: str, task: Callable[[], ShardContent], run: str) -> Record:
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
    if _record_of(name) in folder.names():
        return _read(Record, folder, _record_of(name))
    shard = task()
    digest = hashlib.sha256(shard.content).hexdigest()
    further = tuple(
        FileRecord(file, len(content), hashlib.sha256(content).hexdigest())
        for file, content in shard.files.items()
    )
    record = Record(name, len(shard.content), digest, shard.items, shard.wrong, run, further)
    for file, content in shard.files.items():
        folder.write(file, content)
    folder.write(name, shard.content)
    folder.write(_record_of(name), _packed(record))
    return record


def conclude(run: ShardedRun, folder: Folder) -> ShardManifest | None:
    """Writes the manifest once every shard is finished; before, returns None.

    Raises:
        DataError: A shard is of another run.
    """
    there = folder.names()
    if not all(_record_of(name) in there for name in run.shards):
        return None
    records = tuple(_read(Record, folder, _record_of(name)) for name in run.shards)
    for record in records:
        if record.run != run.digest:
            raise DataError(f"{folder}: {record.name} is of another run; delete it and its record")
    # Whoever comes last writes it; if two do, both write the same bytes.
    manifest = ShardManifest(run, records)
    folder.write(MANIFEST_FILE, _packed(manifest))
    folder.tidy()
    return manifest


def check(folder: Folder) -> ShardManifest:
    """Reads a finished run and compares every file with the manifest, byte by byte.

    Raises:
        DataError: A file is missing or differs, numbers do not add up, or the run is not finished.
    """
    there = folder.names()
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
        content = folder.read(record.name)
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
    return (json.dumps(to_json(value), indent=1, ensure_ascii=False) + "\n").encode()


def _read(cls: type, folder: Folder, name: str) -> Any:
    path = f"{folder}/{name}"
    with blamed_on(path):
        return from_json(cls, parse_json(folder.read(name), path))
