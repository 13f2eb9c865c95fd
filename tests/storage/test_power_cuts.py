"""Power cuts: a layer over the disk forgets what was not synced; nothing acknowledged is lost."""

from __future__ import annotations

import asyncio
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from safetensors.numpy import save_file

from latentmotion import formats
from latentmotion.motion import Motion
from latentmotion.service.jobs import Jobs
from latentmotion.service.schemas import BatchRequest
from latentmotion.service.state import Service
from latentmotion.storage import files, shards
from latentmotion.storage.configuration import write_json
from latentmotion.storage.shards import folder_at
from latentmotion.studio.library import Library
from latentmotion.studio.projects import write as write_project
from tests.support.walker import walker

# Takes a file's path in the folder, and the content that is then promised; None for any.
Acknowledge = Callable[[str, str | None], None]


class PowerCutError(BaseException):
    """The power is gone."""


class Disk:
    """What a disk keeps of a folder: content and names as they were last synced."""

    def __init__(self, root: Path) -> None:
        self.root, self.operations, self.cut_at = root, 0, 10**9
        self._names: dict[int, dict[str, int]] = {}
        self._content: dict[int, bytes] = {}
        self._held: list[int] = []  # open, so that no inode is given to another file
        self._sync(os.open(root, os.O_RDONLY))

    def _sync(self, place: int) -> None:
        self._held.append(os.open(f"/proc/self/fd/{place}", os.O_RDONLY))
        about = os.fstat(place)
        if stat.S_ISDIR(about.st_mode):
            entries = list(os.scandir(place))
            self._names[about.st_ino] = {entry.name: entry.inode() for entry in entries}
            for entry in entries:
                if entry.is_dir():
                    self._names.setdefault(entry.inode(), {})
            folder = Path(f"/proc/self/fd/{place}")
            self._held += [os.open(folder / entry.name, os.O_RDONLY) for entry in entries]
        else:
            self._content[about.st_ino] = Path(f"/proc/self/fd/{place}").read_bytes()

    def _before(self) -> None:
        self.operations += 1
        if self.operations == self.cut_at:
            raise PowerCutError

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Sees the calls that change names or sync, and cuts the power before one of them."""
        replace, mkdir = Path.replace, Path.mkdir

        def fsync(place: int) -> None:
            self._before()
            if Path(f"/proc/self/fd/{place}").readlink().is_relative_to(self.root):
                self._sync(place)

        def replaced(path: Path, target: Path) -> Path:
            self._before()
            return replace(path, target)

        def made(path: Path, *options: object, **named: object) -> None:
            self._before()
            mkdir(path, *options, **named)  # type: ignore[arg-type]

        with (
            mock.patch("os.fsync", fsync),
            mock.patch.object(Path, "replace", replaced),
            mock.patch.object(Path, "mkdir", made),
            mock.patch.object(files, "is_durable", lambda path: True),
            mock.patch.object(files, "_NAMED", set()),
            suppress(PowerCutError),
        ):
            yield

    def after_the_cut(self, target: Path) -> Path:
        """Writes what is left, with files that were named and never synced empty."""
        self._write(self._names[self.root.stat().st_ino], target)
        for place in self._held:
            os.close(place)
        return target

    def _write(self, names: dict[str, int], target: Path) -> None:
        target.mkdir()
        for name, inode in names.items():
            if inode in self._names:
                self._write(self._names[inode], target / name)
            else:
                (target / name).write_bytes(self._content.get(inode, b""))


def a_file(root: Path, acknowledge: Acknowledge) -> None:
    (root / "new").mkdir(exist_ok=True)
    for text in ("1", "2"):
        write_json(root / "new" / "a.json", {"text": text})
        acknowledge("new/a.json", text)


def a_folder(root: Path, acknowledge: Acknowledge) -> None:
    for text in ("1", "2"):
        with files.atomic_folder(root / "model", "card") as folder:
            (folder / "card").write_text(text)
            (folder / "deep").mkdir()
            (folder / "deep" / "weights").write_text(text * 1000)
        acknowledge("model/card", text)
        acknowledge("model/deep/weights", text * 1000)


def a_job(root: Path, acknowledge: Acknowledge) -> None:
    async def add() -> str:
        return Jobs(mock.Mock(spec=Service), root / "jobs").add(BatchRequest(prompts=["a walk"])).id

    for _ in range(2):
        acknowledge(f"jobs/{asyncio.run(add())}/request.json", "a walk")


def a_library(root: Path, acknowledge: Acknowledge) -> None:
    library = Library(root / "library")
    try:
        (level,) = library._database.execute("PRAGMA synchronous").fetchone()
        assert level == 2, "SQLite syncs each take before it is acknowledged"
        for seed in range(2):
            joints = walker(10).joints().astype("f4") + np.float32(seed)
            digest = library.store(Motion(joints))
            acknowledge(f"library/motions/{digest}.npz", None)
        write_project(library.folder / "projects", "Walk", {"bones": True})
        acknowledge("library/projects/Walk.json", "bones")
    finally:
        library.close()


def a_run(root: Path, acknowledge: Acknowledge) -> None:
    """Shards, as of `latentmotion bulk`."""
    content = shards.ShardContent(b"motions", 1, ())
    tasks = {name: lambda: content for name in ("1.bin", "2.bin")}
    work = shards.Work(shards.ShardedRun({"seed": 1}, 2, tuple(tasks)), tasks)
    folder = folder_at(root / "run", create=True)
    shards.make(work, folder, report=lambda record: acknowledge(f"run/{record.name}", "motions"))
    acknowledge("run/manifest.json", "2.bin")


def a_snapshot(root: Path, acknowledge: Acknowledge) -> None:
    """State of a training, of which the next one takes the place."""
    for step in ("1", "2"):
        with files.atomic_file(root / "snapshot.safetensors") as temporary:
            save_file({"step": np.array([int(step)])}, temporary, {"step": step})
        acknowledge("snapshot.safetensors", f'"step":"{step}"')


WORKS = [a_file, a_folder, a_job, a_library, a_run, a_snapshot]


@pytest.mark.parametrize("work", WORKS)
def test_what_was_acknowledged_is_there_after_a_power_cut(
    work: Callable[[Path, Acknowledge], None], tmp_path: Path
) -> None:
    cut = 0
    while True:
        cut += 1
        root = tmp_path / f"{work.__name__} {cut}"
        root.mkdir()
        promised: dict[str, str | None] = {}
        disk = Disk(root)
        disk.cut_at = cut
        with disk.watched():
            work(root, promised.__setitem__)
        left = disk.after_the_cut(tmp_path / f"{work.__name__} {cut} left")
        for name, content in promised.items():
            assert (left / name).is_file(), f"cut {cut}: {name} is lost"
            assert content is None or content in (left / name).read_text(errors="replace")
        for path in left.rglob("*"):
            hidden = any(part.startswith(".") for part in path.relative_to(left).parts)
            if path.is_file() and not hidden and path.name != "lock" and "sqlite" not in path.name:
                assert path.stat().st_size, f"cut {cut}: {path} has a name and no content"
            if path.suffix == ".npz" and not hidden:
                assert len(formats.load(path)[0]) == 10
        if disk.operations < cut:
            break
    print(f"{work.__name__}: {cut - 1} power cuts")
    assert cut > 8, f"{cut} power cuts"
