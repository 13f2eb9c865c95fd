"""The fixed lists of val and test, and that no recording is on both sides."""

from __future__ import annotations

import re
import tarfile
from itertools import pairwise
from pathlib import Path

import pytest

from latentmotion.data.recording import Recording
from latentmotion.data.sources.cmu import rows_by_trial
from latentmotion.data.sources.hdm05 import split_of as hdm05_split
from latentmotion.data.sources.humanml3d import read_splits
from latentmotion.data.sources.snu import (
    held_out,
    pieces_of,
    recording_of,
    snu_recordings,
    split_of,
)


def test_the_lists_hold_what_was_fixed() -> None:
    found = held_out()
    counts = {
        (source, split): sum((c.source, c.split) == (source, split) for c in found.values())
        for source in ("cmu", "hdm05", "snu")
        for split in ("val", "test")
    }
    assert counts == {
        **{("cmu", "val"): 77, ("cmu", "test"): 81, ("hdm05", "val"): 16},
        **{("hdm05", "test"): 55, ("snu", "val"): 178, ("snu", "test"): 316},
    }
    assert all(20 <= clip.frames <= 201 for name, clip in found.items() if clip.source != "hdm05")


def test_listed_takes_are_held_out_as_wholes() -> None:
    for name, clip in held_out().items():
        if clip.source == "snu":
            assert split_of("snu", recording_of(name[4:-6])) == clip.split, name
        if clip.source == "hdm05":
            assert hdm05_split(name, name.split("_")[1]) == clip.split, name


def test_pieces_of_a_listed_take_do_not_overlap() -> None:
    for take in {name.rpartition("-")[0] for name, c in held_out().items() if c.source == "snu"}:
        spans = pieces_of(take)
        assert all(end <= start for (_, end), (start, _) in pairwise(spans))


def test_cmus_listed_clips_never_train(shared: Path) -> None:
    folder = shared / "data" / "humanml3d"
    splits = read_splits(folder)
    trials = {row.id: trial for trial, rows in rows_by_trial(folder).items() for row in rows}
    held = {trials[row] for row, split in splits.items() if split != "train" and row in trials}
    for name, clip in held_out().items():
        if clip.source == "cmu":
            assert trials[name] in held
            assert clip.split == "val" if splits[name] == "train" else clip.split == splits[name]


def test_preparation_follows_the_lists(shared: Path, tmp_path: Path) -> None:
    archive = shared / "data" / "snu.tar.xz"
    if not archive.is_file():
        pytest.skip("needs snu.tar.xz")
    with tarfile.open(archive) as tar:
        kinds = re.compile("snu/(tennis|martial_arts)/")
        some = [member for member in tar.getmembers() if kinds.search(member.name)]
        tar.extractall(tmp_path, some, filter="data")
    found = [item for item in snu_recordings(tmp_path) if isinstance(item, Recording)]
    held = {i.label.id: len(i.joints) for i in found if i.label.split != "train"}
    stems = {i.label.id[4:-6] for i in found}
    listed = {n: c.frames for n, c in held_out().items() if n[4:-6] in stems}
    assert held == listed
    assert held
    trained = {recording_of(i.label.id[4:-6]) for i in found if i.label.split == "train"}
    assert not trained & {recording_of(name[4:-6]) for name in held}
