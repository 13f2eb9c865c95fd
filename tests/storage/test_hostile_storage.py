"""Pickles, JSON, text and xz that lie, and temporary files of killed writers."""

from __future__ import annotations

import json
import lzma
import os
import pickle
import signal
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from latentmotion.errors import FileFormatError, InputError
from latentmotion.storage import pickles
from latentmotion.storage.configuration import read_plain
from latentmotion.storage.files import atomic_file, atomic_folder, read_lines
from latentmotion.storage.reading import read_table, unpack_xz


class Made:
    """Pickles as a call, or as what NumPy's arrays are made of."""

    def __init__(self, *parts: object) -> None:
        self.parts = parts

    def __reduce__(self) -> tuple:
        return self.parts


EMPTY = np.zeros(1).__reduce__()[0]
ADDRESSES = (1, (2,), np.dtype("O"), False, struct.pack("<2Q", 4096, 8192))
SHARED = b"\x80\x04]\x94(" + b"h\x00" * 3 + b"e."
TWICE = [[0] * 10**4]
for _ in range(5):
    TWICE = [TWICE[0] if len(TWICE) == 1 else TWICE] * 300

HOSTILE = {
    "objects by address": Made(EMPTY, (np.ndarray, (0,), b"b"), ADDRESSES),
    "an array without contents": Made(EMPTY, (np.ndarray, (10**7,), b"b")),
    "an array made at once": Made(np.ndarray, ((4,),)),
    "fewer contents than its shape": Made(
        EMPTY, (np.ndarray, (0,), b"b"), (1, (99,), np.dtype("f8"), False, bytes(8))
    ),
    "3 GB of zeros": Made(bytearray, (3 << 30,)),
    "3 GB of bytes": Made(bytes, (3 << 30,)),
    "lists by reference": TWICE,
    "types of several fields": np.zeros(2, [("a", "f4"), ("b", "O")]),
    "an object as a number": Made(np.float64(1).__reduce__()[0], (np.dtype("O"), bytes(8))),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_pickles(kind: str, tmp_path: Path) -> None:
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(HOSTILE[kind], protocol=4))
    with pytest.raises(FileFormatError, match=r"a\.pkl: "):
        pickles.load(tmp_path / "a.pkl")


def test_a_pickle_that_repeats_its_contents(tmp_path: Path) -> None:
    (tmp_path / "a.pkl").write_bytes(SHARED)
    with pytest.raises(FileFormatError, match=r"a\.pkl: "):
        pickles.load(tmp_path / "a.pkl")


@pytest.mark.parametrize("content", [b"]r\xff\xff\xff\x7f.", b"]p99999999999\n."])
def test_places_of_large_numbers_take_no_memory(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.pkl").write_bytes(content)
    tracemalloc.start()
    assert pickles.load(tmp_path / "a.pkl") == []
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()


def test_a_large_sparse_matrix_of_few_numbers(tmp_path: Path) -> None:
    sparse = pytest.importorskip("scipy.sparse")
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(sparse.csc_matrix((10**6, 10**6))))
    with pytest.raises(FileFormatError, match="sparse matrix of shape"):
        pickles.load(path)


@pytest.mark.parametrize(
    "text",
    ["[" * 10**5, "[" * 300 + "]" * 300, "[1e999]", "[NaN]", f"[{'9' * 30}]", '"\\ud800"'],
)
def test_json(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=r"a\.json.*JSON"):
        read_plain(tmp_path / "a.json")


def test_brackets_in_text_are_no_nesting(tmp_path: Path) -> None:
    text = '\\" [[[ {' * 200
    (tmp_path / "a.json").write_text(json.dumps({"a": [text, {"b": "\\"}]}))
    assert read_plain(tmp_path / "a.json") == {"a": [text, {"b": "\\"}]}


def test_text_names_the_line_that_is_not_utf_8(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes("walk\nGrüße\n".encode("latin1"))
    with pytest.raises(InputError, match=r"a\.txt:2: found the byte 0xfc, which is not UTF-8"):
        read_lines(tmp_path / "a.txt", "label")


def test_tables_name_their_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1," + "x" * 200_000)
    with pytest.raises(FileFormatError, match=r"a\.csv.*not CSV"):
        read_table(tmp_path / "a.csv", ("a",))
    (tmp_path / "a.csv").write_text('a,b\n"1\n2",x\n3\n')
    assert read_table(tmp_path / "a.csv", ("a",)) == [
        (3, {"a": "1\n2", "b": "x"}),
        (4, {"a": "3", "b": ""}),
    ]


def test_xz_that_unpacks_to_far_more_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.xz").write_bytes(lzma.compress(bytes(80_000_000), preset=0))
    with pytest.raises(FileFormatError, match="unpack to more than"):
        unpack_xz(tmp_path / "a.xz")
    (tmp_path / "a.xz").write_bytes(lzma.compress(b"abc")[:-4])
    with pytest.raises(FileFormatError, match="cut short"):
        unpack_xz(tmp_path / "a.xz")


KILLED = """
import os, signal, sys
from latentmotion.storage.files import atomic_file, atomic_folder
with atomic_file(sys.argv[1]) as file, atomic_folder(sys.argv[2], "marker") as folder:
    file.write_text("half")
    (folder / "marker").write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="no such signal")
def test_what_a_killed_writer_left_is_removed_by_the_next(tmp_path: Path) -> None:
    targets = tmp_path / "a[1].npz", tmp_path / "model"
    done = subprocess.run([sys.executable, "-c", KILLED, *map(str, targets)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(list(tmp_path.iterdir())) == 2
    with atomic_file(targets[0]) as file, atomic_folder(targets[1], "marker") as folder:
        file.write_text("whole")
        (folder / "marker").write_text("whole")
        with atomic_file(targets[0]) as other:  # a writer at the same time keeps its own
            other.write_text("other")
        assert file.is_file() and folder.is_dir()
    assert {path.name for path in tmp_path.iterdir()} == {"a[1].npz", "model"}


KILLED_BETWEEN = """
import os, signal, sys
from pathlib import Path
from latentmotion.storage.files import atomic_folder

replace = Path.replace
def killed_replace(path, target):
    replace(path, target)
    os.kill(os.getpid(), signal.SIGKILL)
with atomic_folder(sys.argv[1], "marker") as folder:
    (folder / "marker").write_text("new")
    Path.replace = killed_replace
"""


@pytest.mark.skipif(os.name == "nt", reason="no such signal")
def test_an_old_folder_survives_a_kill_while_it_is_replaced(tmp_path: Path) -> None:
    target = tmp_path / "model"
    with atomic_folder(target, "marker") as folder:
        (folder / "marker").write_text("old")
    done = subprocess.run([sys.executable, "-c", KILLED_BETWEEN, str(target)], check=False)
    assert done.returncode == -signal.SIGKILL and not target.exists()
    with pytest.raises(KeyError), atomic_folder(target, "marker"):
        assert (target / "marker").read_text() == "old"
        raise KeyError
    assert (target / "marker").read_text() == "old"
    with atomic_folder(target, "marker") as folder:
        (folder / "marker").write_text("new")
    assert (target / "marker").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["model"]
