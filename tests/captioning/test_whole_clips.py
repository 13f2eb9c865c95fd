"""Lengths of whole clips, random generators of clips, and crops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.data.dataset import Cropping, Dataset, Item
from latentmotion.errors import DataError
from latentmotion.training.captioning.described import clip_generator
from latentmotion.training.lengths import (
    SHORTEST_ACT,
    CaptionLengths,
    joined,
    prepared_caption_lengths,
)
from tests.support.moving_figures import write_moving_figures


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("data") / "figures"
    return Dataset.load(write_moving_figures(folder, train=4, val=2))


def with_captions(dataset: Dataset, rows: list[tuple[str, int, int]]) -> Dataset:
    first = dataset.manifest.clips[0]
    captions = tuple((*row, "") for row in rows)
    clips = (replace(first, captions=captions), *dataset.manifest.clips[1:])
    return replace(dataset, manifest=replace(dataset.manifest, clips=clips))


def test_lengths_are_of_whole_clips(dataset: Dataset) -> None:
    whole = dataset.manifest.clips[0].frames
    rows = [("a person jumps", 0, 10), ("a person walks", 0, whole), ("one kicks", 3, whole)]
    found = prepared_caption_lengths(with_captions(dataset, rows), "train")
    lengths = dict(zip(found.sentences, found.seconds.tolist(), strict=True))
    assert lengths["a person walks"] == pytest.approx(max(whole / 20, SHORTEST_ACT))
    assert not lengths.keys() & {"a person jumps", "one kicks"}
    parts = with_captions(dataset, rows[:1]).manifest
    some = replace(dataset, manifest=replace(parts, clips=parts.clips[:1]))
    with pytest.raises(DataError, match="no caption of the split train tells of a whole clip"):
        prepared_caption_lengths(some, "train")


def test_sets_of_lengths_are_joined_in_order() -> None:
    sets = [CaptionLengths((name,), np.array([n], np.float32)) for n, name in enumerate("ab", 1)]
    both = joined(sets)
    assert both.sentences == ("a", "b") and both.seconds.tolist() == [1, 2]


def test_generators_of_clips_depend_on_name_and_seed() -> None:
    draws = [clip_generator(*at).random() for at in ((0, "a"), (0, "b"), (1, "a"), (0, "a"))]
    assert len(set(draws)) == 3 and draws[0] == draws[3]


@pytest.mark.parametrize(("frames", "expected"), [(8, {8}), (12, {8, 12}), (300, {36, 40})])
def test_one_crop_in_three_is_a_unit_shorter(dataset: Dataset, frames: int, expected: set) -> None:
    item = Item(dataset.clips("train")[0], 5, 5 + frames, ("a", "b"))
    generator = np.random.default_rng(0)
    crops = [Cropping(max_frames=40).crop(item, generator) for _ in range(300)]
    assert {crop.frames for crop in crops} == expected
    shorter = sum(crop.frames == min(expected) for crop in crops) / 300
    assert len(expected) == 1 or shorter == pytest.approx(1 / 3, abs=0.08)
    assert all(item.start <= crop.start <= item.end - crop.frames for crop in crops)
    assert {crop.caption for crop in crops} == {"a", "b"}
