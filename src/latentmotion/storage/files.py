"""Atomic, durable writes: a failure or a power cut leaves the old file, the new one, or none.

What is written is on the disk before it gets its name, and the name before the writer goes on. In
the system's folder for temporary files nothing is promised, and nothing waits for the disk.
Files get the user's default permissions; safetensors alone would make its own unreadable to others.
What a killed process left is removed when the same is written again; a temporary file is named
after the machine and the process that writes it, so that writers at the same time keep theirs.
"""

from __future__ import annotations

import errno
import glob
import hashlib
import os
import platform
import re
import secrets
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from latentmotion.errors import DiskFullError, FileFormatError, InputError
from latentmotion.storage import limits, reading


def _failures() -> tuple[type[Exception], ...]:
    """Returns errors of writing, as on a full disk; safetensors, if it is in use, has its own."""
    safetensors = sys.modules.get("safetensors")
    return (OSError,) if safetensors is None else (OSError, safetensors.SafetensorError)


def is_disk_full(error: Exception) -> bool:
    """Returns whether a write failed because the disk, or the user's quota, is full."""
    full = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
    return full or isinstance(error, DiskFullError)


@contextmanager
def atomic_file(path: str | Path) -> Iterator[Path]:
    """Yields a temporary path beside `path`, renamed onto it when the block succeeds.

    Raises:
        DiskFullError: There is no room for it.
        InputError: The folder does not exist or cannot be written.
    """
    target = Path(path)
    temporary = _temporary_name(target)
    try:
        temporary.touch()
        mode = temporary.stat().st_mode
        temporary.unlink()
        yield temporary
        with suppress(OSError):  # not every file system knows permissions
            temporary.chmod(mode)
        durable = is_durable(target)
        if durable:
            sync(temporary)
        temporary.replace(target)
        if durable:
            sync_names(target)
    except _failures() as error:
        raise _unwritable(target, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_file(path: str | Path, content: str | bytes) -> None:
    """Writes a whole file, text as UTF-8, as `atomic_file` does."""
    with atomic_file(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def atomic_folder(path: str | Path, marker: str) -> Iterator[Path]:
    """Yields an empty temporary folder, put in place of `path` when the block succeeds.

    Args:
        path: The folder to write.
        marker: A file that every folder of this kind has; a folder without it is not replaced.

    Raises:
        InputError: The parent cannot be written, or there is something else in this place.
    """
    target = Path(path)
    aside = target.absolute().parent / f".{_short(target.name)}.replaced"
    _put_back(aside, target)  # a writer was killed between the two renames below
    check_replaceable(target, marker)
    temporary = _temporary_name(target)
    try:
        temporary.mkdir()
        yield temporary
        for file in temporary.rglob("*"):
            if file.is_file() and not file.is_symlink():
                with suppress(OSError):  # not every file system knows permissions
                    file.chmod(temporary.stat().st_mode & 0o666)
        durable = is_durable(target)
        if durable:
            for entry in (*temporary.rglob("*"), temporary):
                sync(entry)
        if target.is_dir():
            target.replace(aside)
        temporary.replace(target)
        if durable:
            sync_names(target)
    except _failures() as error:
        raise _unwritable(target, error) from error
    finally:
        _put_back(aside, target)
        shutil.rmtree(temporary, ignore_errors=True)


def is_durable(path: Path) -> bool:
    """Returns whether a file is to survive a power cut: it is not in a temporary folder."""
    return not path.absolute().is_relative_to(tempfile.gettempdir())


def sync(path: Path) -> None:
    """Waits until a file's content, or the names in a folder, are on the disk."""
    if path.is_dir() and os.name == "nt":  # Windows opens no folders, and keeps names itself
        return
    descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:  # some network file systems have no such call
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def sync_names(path: Path) -> None:
    """Waits until a file's name, and those of the folders above it, are on the disk."""
    folder = path.absolute().parent
    sync(folder)
    while folder != folder.parent and (key := (folder, folder.stat().st_ino)) not in _NAMED:
        with suppress(PermissionError):  # it is a folder of others, which was there before
            sync(folder.parent)
        _NAMED.add(key)
        folder = folder.parent


# Folders whose own names are on the disk, and their inodes.
_NAMED: set[tuple[Path, int]] = set()


def check_replaceable(path: str | Path, marker: str) -> None:
    """Checks early that a folder could be written at `path` without losing anything else.

    Raises:
        InputError: The parent cannot be written, or there is something else in this place.
    """
    target = Path(path)
    with suppress(OSError, ValueError):
        target.absolute().parent.mkdir(parents=True, exist_ok=True)
    check_writable(target)
    occupied = target.is_file() or (target.is_dir() and any(target.iterdir()))
    if occupied and not (target / marker).is_file():
        raise InputError(f"{target} exists and has no {marker}; choose another folder")


def check_writable(path: str | Path) -> None:
    """Checks early that a file could be written at `path`.

    Raises:
        InputError: The folder does not exist or cannot be written, or the file is read-only.
    """
    if "\0" in str(path):
        raise InputError(f"cannot write {str(path)!r}: a name cannot hold NUL")
    try:
        Path(path).exists()
    except OSError as error:  # a name too long
        raise _unwritable(Path(path), error) from error
    folder = Path(path).absolute().parent
    if not folder.is_dir():
        raise InputError(f"cannot write {path}: the folder {folder} does not exist; create it")
    if not os.access(folder, os.W_OK):
        raise InputError(f"cannot write {path}: no permission to write in {folder}")
    if Path(path).exists() and not os.access(path, os.W_OK):
        raise InputError(f"cannot write {path}: it is read-only; allow writing or choose another")


def remove_left(folder: Path, stem: str | None = None, suffix: str | None = None) -> None:
    """Removes temporary files and folders whose writers were killed.

    Args:
        folder: Where they are.
        stem: Name of the file that was to be written, without its ending; by default any.
        suffix: Its ending; by default any.
    """
    stem = None if stem is None else _short(stem)
    begin = "*" if stem is None else glob.escape(stem)
    for entry in folder.glob(f".{begin}.*{'' if suffix is None else glob.escape(suffix)}"):
        named = _TEMPORARY.fullmatch(entry.name)
        ours = named and stem in (None, named["stem"]) and suffix in (None, named["suffix"])
        if named and ours and _is_left(entry, named["machine"], int(named["process"])):
            with suppress(OSError):
                shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


def read_lines(path: str | Path, what: str) -> list[str]:
    """Returns the lines of a text file, stripped, without empty ones.

    Args:
        path: The file.
        what: What a line holds, for errors.

    Raises:
        InputError: It cannot be read as text, or has no line.
    """
    try:
        text = reading.read_text(path)
    except FileFormatError as error:
        raise InputError(f"{what}s: {error}") from error
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not lines:
        raise InputError(f"{path} holds no {what}; expected one per line")
    return lines


def sha256(path: str | Path) -> str:
    """Returns the SHA-256 of a file as hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _put_back(aside: Path, target: Path) -> None:
    """Gives a folder that was set aside its name again, or removes it if there is a new one."""
    with suppress(OSError):
        if aside.is_dir() and not target.exists():
            aside.replace(target)
        shutil.rmtree(aside, ignore_errors=True)


def _unwritable(target: Path, error: Exception) -> InputError:
    kind = DiskFullError if is_disk_full(error) else InputError
    return kind(f"cannot write {target}: {getattr(error, 'strerror', None) or error}")


def _temporary_name(target: Path) -> Path:
    """Returns an unused name beside a file, and removes what killed writers left of the same."""
    check_writable(target)
    folder, token = target.absolute().parent, f"{_machine()}-{os.getpid()}-{secrets.token_hex(4)}"
    remove_left(folder, target.stem, target.suffix)
    # The ending is kept last, since many writers choose their format by it.
    ending = target.suffix if len(os.fsencode(target.suffix)) < _LONG else ""
    return folder / f".{_short(target.stem)}.{token}{ending}"


def _short(stem: str) -> str:
    """Returns a name that leaves room for more in the 255 bytes that file systems allow."""
    name = os.fsencode(stem)
    return stem if len(name) < _LONG else f"{hashlib.sha256(name).hexdigest()}"


# Bytes of a name that is shortened.
_LONG = 128


# Name of a temporary file: of what, machine and process that write it, what tells its files apart,
# ending.
_TEMPORARY = re.compile(
    r"\.(?P<stem>.*)\.(?P<machine>[0-9a-f]{8})-(?P<process>\d{1,10})-[0-9a-f]{8}"
    r"(?P<suffix>|\.[^.]*)",
    re.DOTALL,
)


@cache
def _machine() -> str:
    """Returns a name by which this machine or container differs from others on a shared disk."""
    try:
        space = str(Path("/proc/self/ns/pid").readlink())
    except OSError:
        space = ""
    return hashlib.sha256(f"{platform.node()} {space}".encode()).hexdigest()[:8]


def _is_left(entry: Path, machine: str, process: int) -> bool:
    """Returns whether the writer of a temporary file is gone."""
    try:
        if machine == _machine() and os.name == "posix":
            os.kill(process, 0)  # asks whether it runs
            return False
        return time.time() - entry.stat().st_mtime > limits.STALE_SECONDS
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False


VARIABLE = "LATENTMOTION_CACHE"  # Environment variable with a folder, or `off`.


def cache_folder() -> Path | None:
    """Returns the folder, which need not exist; None if caching is off."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return None if chosen == "off" else Path(chosen)
    try:
        return user_folder("XDG_CACHE_HOME", ".cache", "Library/Caches")
    except RuntimeError:  # a user without a home
        return None


def user_folder(variable: str, usual: str, on_mac: str) -> Path:
    """Returns this user's folder for files of ours, as the platform has it.

    Args:
        variable: Environment variable with the folder for all programs; on Windows LOCALAPPDATA.
        usual: Its usual place below the home.
        on_mac: Its place there on macOS.

    Raises:
        RuntimeError: The user has no home.
    """
    if sys.platform == "darwin":
        return Path.home() / on_mac / "latentmotion"
    named = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else variable)
    return (Path(named) if named else Path.home() / usual) / "latentmotion"
