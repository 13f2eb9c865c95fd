from __future__ import annotations

import tarfile
from collections import Counter
from pathlib import Path

import pytest

from latentmotion.data.clip import mirror_words
from latentmotion.data.prepare import encode
from latentmotion.data.recording import EncodedRecording, Recording
from latentmotion.data.sources.hdm05 import CLASSES, find_clips, hdm05_groups, split_of
from latentmotion.errors import DataError
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES


def test_every_class_has_sentences() -> None:
    assert len(CLASSES) == 11
    for about in CLASSES.values():
        assert len(about.sentences) == 3
        assert all(s.endswith(".") for s in about.sentences)


def test_one_sided_classes_have_another_mirrored_label() -> None:
    for name, about in CLASSES.items():
        sided = any(mirror_words(s) != s for s in about.sentences)
        assert sided == (about.mirrored != name)


def test_splits_by_actor_and_hash() -> None:
    names = [f"HDM_bd_squat1Reps_{n:03d}_120" for n in range(300)]
    found = Counter(split_of(name, "bd") for name in names)
    assert 15 < found["val"] < 45
    assert "test" not in found
    assert {split_of(name, "tr") for name in names} == {"test"}


def test_folders_without_clips(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no folder"):
        find_clips(tmp_path / "none")
    (tmp_path / "05_18.amc").write_text("")
    with pytest.raises(DataError, match="expected cut clips"):
        find_clips(tmp_path)


def test_real_clips_of_one_actor(tmp_path: Path, shared: Path) -> None:
    with tarfile.open(shared / "data/hdm05_asfamc.tar.xz", "r|xz") as tar:
        for _, member in zip(range(31), tar, strict=False):
            tar.extract(member, tmp_path, filter="data")
    groups = hdm05_groups(tmp_path, 10)
    assert [len(group.files) for group in groups] == [10, 10, 8]
    items = [item for group in groups for item in group.read()]
    assert len(items) == 28
    assert all(isinstance(item, Recording) and item.label.sentences for item in items)
    encoded = [encode(item, HUMANML3D_FEATURES) for item in items if isinstance(item, Recording)]
    kept = [item for item in encoded if isinstance(item, EncodedRecording)]
    assert len(kept) == 28
    assert max(item.round_trip_mm or 0 for item in kept) < 5
