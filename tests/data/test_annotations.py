"""What sources say of their recordings: rates, trials, labels, views, splits."""

from __future__ import annotations

import json
import lzma
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.sources.cmu import native_fps, trial_of
from latentmotion.data.sources.hdm05 import CLASSES
from latentmotion.data.sources.humanml3d import (
    official_normalizer,
    read_index,
    read_splits,
    read_texts,
)
from latentmotion.data.sources.snu import TEST, VAL, held_out, pieces_of, split_of
from latentmotion.errors import DataError, FileFormatError
from latentmotion.training.lengths import (
    read_caption_lengths,
)


@pytest.mark.parametrize(
    ("trial", "fps"),
    [("05_18", 120), ("60_01", 60), ("74_09", 120), ("89_01", 60), ("89_02", 120), ("143_05", 60)],
)
def test_native_rates(trial: str, fps: float) -> None:
    assert native_fps(trial) == fps


@pytest.mark.parametrize(
    ("path", "trial"),
    [
        ("./pose_data/CMU/05/05_18_poses.npy", "05_18"),
        ("./pose_data/CMU/18_19_Justin/18_02_poses.npy", "18_02"),
        ("./pose_data/CMU/18_19_rory/18_02_poses.npy", "19_02"),
        ("./pose_data/CMU/9/9_1_poses.npy", "09_1"),
        ("./pose_data/KIT/05/05_18_poses.npy", None),
        ("./pose_data/CMU/05/05_18.npy", None),
    ],
)
def test_trials_behind_paths(path: str, trial: str | None) -> None:
    assert trial_of(path) == trial


@pytest.mark.parametrize(
    ("files", "read", "message"),
    [
        ({}, read_texts, r"expected captions in texts/\*.txt or texts.json.xz, found neither"),
        ({"texts/a.md": b""}, read_texts, "no .txt file in it"),
        ({"texts.json.xz": b"zip"}, read_texts, "damaged"),
        ({"texts.json.xz": lzma.compress(b"[1]")}, read_texts, "by id, found a list"),
        ({}, read_splits, "lacks train.txt"),
        ({f"{n}.txt": b"\n" for n in ("train", "val", "test")}, read_splits, "are empty"),
        ({"index.csv": b""}, read_index, "lacks the column source_path, .*found nothing"),
        ({"index.csv": b"source_path,start_frame,end_frame,new_name\na,0,x,b\n"}, read_index,
         "index.csv:2: expected numbers of frames"),
        ({}, lambda folder: read_index(folder / "no"), "no folder .*no; it should hold HumanML3D"),
    ],
)  # fmt: skip
def test_annotations_that_are_not_there(
    tmp_path: Path, files: dict[str, bytes], read: Callable[[Path], object], message: str
) -> None:
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    with pytest.raises((DataError, FileFormatError), match=message):
        read(tmp_path)


@pytest.mark.parametrize(
    ("mean", "std", "message"),
    [
        (
            np.zeros(3),
            np.ones(4),
            r"the shapes \(3,\) and \(4,\), expected \(4,\); is it the other",
        ),
        (np.zeros(4), np.zeros(4), "hold"),
        (np.full(4, np.nan), np.ones(4), "hold"),
    ],
)
def test_statistics_that_cannot_be(tmp_path: Path, mean, std, message: str) -> None:
    np.save(tmp_path / "Mean.npy", mean)
    np.save(tmp_path / "Std.npy", std)
    with pytest.raises(DataError, match=message):
        official_normalizer(tmp_path, 4)


def test_classes_are_mirrored_twice_to_themselves() -> None:
    for name, known in CLASSES.items():
        back = CLASSES.get(known.mirrored)
        assert back is None or back.mirrored == name
        assert len(set(known.sentences)) == 3


def test_splits_by_hash_have_their_shares() -> None:
    splits = [split_of("cmu", f"{number}") for number in range(4000)]
    assert splits == [split_of("cmu", f"{number}") for number in range(4000)]
    assert splits != [split_of("snu", f"{number}") for number in range(4000)]
    assert splits.count("test") / 4000 == pytest.approx(TEST, abs=0.02)
    assert splits.count("val") / 4000 == pytest.approx(VAL, abs=0.015)


def test_fixed_pieces_do_not_overlap() -> None:
    takes = {name.rpartition("-")[0] for name, clip in held_out().items() if clip.source == "snu"}
    assert takes
    for take in takes:
        pieces = pieces_of(take)
        assert pieces == sorted(pieces) and all(start < end for start, end in pieces)
        assert all(one[1] <= two[0] for one, two in pairwise(pieces))
    assert pieces_of("no such take") == []


def test_an_index_without_the_split(tmp_path: Path) -> None:
    (tmp_path / "index.csv").write_text(
        "source_path,start_frame,end_frame,new_name\na,0,90,1.npy\n"
    )
    (tmp_path / "texts.json.xz").write_bytes(lzma.compress(json.dumps({"1": "he walks"}).encode()))
    for split, names in (("train", "1"), ("val", ""), ("test", "")):
        (tmp_path / f"{split}.txt").write_text(names)
    assert read_caption_lengths(tmp_path, "train").seconds.tolist() == pytest.approx([89 / 20])
    with pytest.raises(DataError, match=r"no sentence of the split val has a length in index\.csv"):
        read_caption_lengths(tmp_path, "val")
