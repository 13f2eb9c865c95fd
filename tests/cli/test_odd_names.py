"""Names up to the file system's limit, and arguments that are not UTF-8."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from latentmotion import MotionPipeline
from latentmotion.errors import DiskFullError, InputError
from latentmotion.storage import files

PROGRAM = str(Path(sys.executable).with_name("latentmotion"))


@pytest.mark.parametrize("letter", ["n", "漢"])
@pytest.mark.parametrize("size", [200, 228, 249, 251])
def test_names_up_to_the_limit_are_written(size: int, letter: str, tmp_path: Path) -> None:
    stem = letter * (size // len(letter.encode()))
    for path in (tmp_path / f"{stem}.bvh", tmp_path / f".{stem[:-1]}", tmp_path / f"a.{stem[:-2]}"):
        with files.atomic_file(path) as temporary:
            temporary.write_text("whole")
        assert path.read_text() == "whole"
    with files.atomic_folder(tmp_path / stem, "marker") as folder:
        (folder / "marker").touch()
    with files.atomic_folder(tmp_path / stem, "marker") as folder:
        (folder / "marker").touch()
    assert len(list(tmp_path.iterdir())) == 4


def test_what_a_killed_writer_of_a_long_name_left_is_removed(tmp_path: Path) -> None:
    target = tmp_path / f"{'n' * 240}.bvh"
    left = files._temporary_name(target)
    left.touch()
    left.rename(left.with_name(left.name.replace(f"-{os.getpid()}-", "-4194304-")))
    with files.atomic_file(target) as temporary:
        temporary.touch()
    assert [path.name for path in tmp_path.iterdir()] == [target.name]


def test_longer_names_are_refused_before_work_is_done(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="File name too long"):
        files.check_writable(tmp_path / f"{'n' * 256}.bvh")


def test_bytes_that_are_not_utf8(tmp_path: Path) -> None:
    words = [PROGRAM, "generate", b"gr\xfc\xdfe", "--seconds", "1", "-o", "a.bvh"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "holds bytes that are not UTF-8" in done.stderr
    with pytest.raises(InputError, match="not UTF-8"):
        MotionPipeline.from_pretrained()("a \ud800 walks", seconds=1)


def test_a_full_disk_is_called_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(place: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    monkeypatch.setattr(files, "is_durable", lambda path: True)
    with (
        pytest.raises(DiskFullError, match="No space left"),
        files.atomic_file(tmp_path / "a") as temporary,
    ):
        temporary.touch()
    assert not list(tmp_path.iterdir())
