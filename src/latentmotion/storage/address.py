"""Folders at an address: a local path, or a URL of any file system that fsspec knows.

A file appears under its name only when it is complete: it is written under another name first and
then renamed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from latentmotion.errors import InputError, MissingExtraError
from latentmotion.storage.files import atomic_file, check_writable, remove_left
from latentmotion.storage.reading import read_bytes

_PART = ".part"


@dataclass(frozen=True)
class LocalFolder:
    """A folder of this machine."""

    path: Path
    """The folder, absolute."""

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
        with atomic_file(self.path / name) as temporary:
            temporary.write_bytes(content)

    def tidy(self) -> None:
        """Removes what killed writers left."""
        remove_left(self.path)


@dataclass(frozen=True)
class RemoteFolder:
    """A folder of a file system of fsspec. It can be pickled, as workers need."""

    url: str
    """Address of the folder, for messages."""
    system: Any
    """fsspec's file system."""
    path: str
    """Path of the folder in it."""

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


Folder = LocalFolder | RemoteFolder
"""A folder of files that are written and read as a whole."""


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
