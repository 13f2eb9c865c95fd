"""A file is written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from safetensors import SafetensorError
from safetensors.numpy import save_file

from latentmotion.errors import InputError
from latentmotion.storage.files import atomic_file, atomic_folder, check_writable, sha256


def test_file_appears_only_when_complete(tmp_path: Path) -> None:
    target = tmp_path / "motion.bvh"
    target.write_text("old")
    with pytest.raises(RuntimeError), atomic_file(target) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert target.read_text() == "old"
    with atomic_file(target) as temporary:
        assert temporary.suffix == ".bvh"
        temporary.write_text("new")
    assert target.read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["motion.bvh"]


@pytest.mark.parametrize("full", [OSError(28, "No space left"), SafetensorError("No space left")])
def test_a_full_disk_is_told_whoever_met_it(tmp_path: Path, full: Exception) -> None:
    message = "cannot write .*motion.bvh: No space left"
    with pytest.raises(InputError, match=message), atomic_file(tmp_path / "motion.bvh"):
        raise full


def test_folder_is_replaced_as_a_whole(tmp_path: Path) -> None:
    for text in ("old", "new"):
        with atomic_folder(tmp_path / "model", "marker") as temporary:
            (temporary / "marker").write_text(text)
    with pytest.raises(RuntimeError), atomic_folder(tmp_path / "model", "marker") as temporary:
        raise RuntimeError
    assert (tmp_path / "model" / "marker").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["model"]


@pytest.mark.skipif(os.name == "nt", reason="no such permissions")
def test_others_may_read_what_they_may_by_default(tmp_path: Path) -> None:
    (tmp_path / "usual").touch()
    with atomic_file(tmp_path / "a.safetensors") as temporary:
        save_file({"a": np.zeros(1)}, temporary)
    with atomic_folder(tmp_path / "model", "marker") as temporary:
        (temporary / "deep").mkdir()
        save_file({"a": np.zeros(1)}, temporary / "deep" / "b.safetensors")
    written = tmp_path / "a.safetensors", tmp_path / "model" / "deep" / "b.safetensors"
    assert {path.stat().st_mode for path in written} == {(tmp_path / "usual").stat().st_mode}


def test_a_folder_of_something_else_is_kept(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").write_text("precious")
    with (
        pytest.raises(InputError, match=r"photos exists and has no model\.json"),
        atomic_folder(tmp_path / "photos", "model.json"),
    ):
        pass
    assert (tmp_path / "photos" / "a.jpg").read_text() == "precious"


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the folder .*absent does not exist"):
        check_writable(tmp_path / "absent" / "a.bvh")
    with pytest.raises(InputError, match="absent"), atomic_file(tmp_path / "absent" / "a.bvh"):
        pass


def test_hash_of_a_known_text(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    assert sha256(tmp_path / "a").startswith("ba7816bf8f01cfea")
