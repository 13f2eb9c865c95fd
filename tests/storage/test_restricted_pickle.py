"""Pickles are read as far as they hold plain values, and never run."""

from __future__ import annotations

import pickle
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest

from latentmotion.errors import FileFormatError
from latentmotion.storage import pickles

PLAIN = {
    "floats": np.arange(6, dtype=np.float32).reshape(2, 3),
    "columns": np.asfortranarray(np.eye(3)),
    "of objects": np.array([[1, 2], "x"], dtype=object),
    "words": np.array(["a", "bc"]),
    "number": np.float64(0.5),
    "nested": [{"a": (1, 2.5, None, True)}, OrderedDict(b=b"\x00\xff"), {3}, 1j],
    "empty": np.zeros((0, 72)),
}


def write(path: Path, value: object, protocol: int = 4) -> Path:
    path.write_bytes(pickle.dumps(value, protocol=protocol))
    return path


def same(one, other):
    if isinstance(one, np.ndarray) and one.dtype != object:
        return one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, (list, tuple, np.ndarray)):
        return all(same(a, b) for a, b in zip(one, other, strict=True))
    return one == other and type(one) is type(other)


@pytest.mark.parametrize("protocol", range(6))
def test_plain_values_of_every_protocol_come_back(tmp_path, protocol):
    expected = PLAIN | {"nested": [PLAIN["nested"][0], {"b": b"\x00\xff"}, {3}, 1j]}
    assert same(pickles.load(write(tmp_path / "a.pkl", PLAIN, protocol)), expected)


def test_pickles_of_older_numpy_and_python_2(tmp_path):
    names = b"numpy.core.multiarray", b"numpy._core.multiarray"  # of numpy 1 and 2
    own = pickle.dumps({"x": np.arange(3.0)}, protocol=2)
    assert any(name in own for name in names)
    for name in names:
        (tmp_path / "a.pkl").write_bytes(own.replace(names[1], name).replace(names[0], name))
        np.testing.assert_array_equal(pickles.load(tmp_path / "a.pkl")["x"], np.arange(3.0))
    # `str` of Python 2 holds bytes.
    (tmp_path / "b.pkl").write_bytes(b"(dp0\nS'caf\\xe9'\np1\nI1\ns.")
    assert pickles.load(tmp_path / "b.pkl") == {"café": 1}


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_sparse_matrices_become_dense(tmp_path, protocol):
    sparse = pytest.importorskip("scipy.sparse")
    matrix = np.random.default_rng(0).random((4, 9)) * (np.arange(9) % 3 == 0)
    path = write(tmp_path / "a.pkl", {"J": [sparse.csc_matrix(matrix)]}, protocol)
    np.testing.assert_array_equal(pickles.load(path)["J"][0], matrix)


class Bomb:
    def __init__(self, *call):
        self.call = call

    def __reduce__(self):
        return self.call


@pytest.mark.parametrize("protocol", [0, 2, 5])
def test_programs_are_named_and_not_run(tmp_path, protocol):
    target = tmp_path / "run"
    path = write(tmp_path / "a.pkl", [1, Bomb(Path.mkdir, (target,))], protocol)
    with pytest.raises(FileFormatError, match=r"a\.pkl: holds .*; it was not read"):
        pickles.load(path)
    assert not target.exists()


def test_nothing_is_reached_through_what_is_allowed(tmp_path):
    for content in (
        b"cos\nsystem\n(S'true'\ntR.",
        b"\x80\x04\x8c\x05numpy\x8c\x0fndarray.__class__\x93.",
        b"ccopyreg\n_reconstructor\n(cnumpy\ndtype\nc__builtin__\nobject\nNtR.",
        b"Pid\n.",
    ):
        (tmp_path / "a.pkl").write_bytes(content)
        with pytest.raises(FileFormatError):
            pickles.load(tmp_path / "a.pkl")


def test_chumpy_says_how_to_convert(tmp_path):
    (tmp_path / "smpl.pkl").write_bytes(b"(dp0\nS'shapedirs'\np1\ncchumpy.ch\nCh\np2\ns.")
    with pytest.raises(FileFormatError, match=r"chumpy\.ch\.Ch.*convert the file once.*savez"):
        pickles.load(tmp_path / "smpl.pkl")


@pytest.mark.parametrize("content", [b"", b"text", pickle.dumps(PLAIN)[:-30]])
def test_damaged_files(tmp_path, content):
    (tmp_path / "a.pkl").write_bytes(content)
    with pytest.raises(FileFormatError, match="download it again"):
        pickles.load(tmp_path / "a.pkl")
    with pytest.raises(FileFormatError, match="No such file"):
        pickles.load(tmp_path / "none.pkl")


def test_word_vectors_indices(shared):
    folder = shared / "data/t2m_vocabulary"
    words = pickles.load(folder / "our_vab_words.pkl")
    index = pickles.load(folder / "our_vab_idx.pkl")
    assert words[:3] == ["sos", "eos", "unk"]
    assert index[words[5]] == 5
