from __future__ import annotations

import numpy as np
import pytest

from latentmotion.data.clip import Caption, Clip
from latentmotion.data.dataset import Crop, Cropping
from latentmotion.errors import InputError
from latentmotion.training.evaluator import (
    HardBatchSampler,
    HardNegatives,
    _describes,
    alike_groups,
    spans_of,
)
from latentmotion.training.experiment import RarityDraws


def clip(number: int, mirrored: bool = False) -> Clip:
    side = "right" if mirrored else "left"
    captions = (Caption(f"kick {number} with the {side} foot", 0, 40),)
    name = f"{'M' * mirrored}{number}"
    return Clip(name, "own", "train", captions, None, mirrored, 40)


CLIPS = [clip(number, side) for number in range(24) for side in (False, True)]


def embed(sentences: list[str]) -> np.ndarray:
    return np.array([[float(sentence.split()[1]), 1.0] for sentence in sentences])


def sampler() -> HardBatchSampler:
    return HardBatchSampler(
        CLIPS, 8, Cropping(), HardNegatives(alike=3, pool=3), 0, embed, RarityDraws()
    )


def test_every_crop_stands_beside_its_mirror_image() -> None:
    crops = sampler()(1)
    assert len(crops) == 8
    for crop, twin in zip(crops[:4], crops[4:], strict=True):
        assert twin.clip.id == f"M{crop.clip.id}"
        assert (twin.start, twin.frames) == (crop.start, crop.frames)
        assert twin.caption == crop.caption.replace("left", "right")


def test_an_epoch_shows_every_clip_and_repeats() -> None:
    shown = [crop.clip.id for step in range(6) for crop in sampler()(step)[:4]]
    assert sorted(shown) == sorted(str(number) for number in range(24))
    assert [crop.clip.id for crop in sampler()(4)[:4]] == shown[16:20]


def test_alike_sentences_come_together() -> None:
    groups = alike_groups(embed([f"a {n}" for n in (5, 1, 4, 0, 2, 3)]), 3)
    assert sorted(sorted(group.tolist()) for group in groups) == [[0, 2, 5], [1, 3, 4]]


def test_without_mirrored_copies_there_are_no_twins() -> None:
    with pytest.raises(InputError, match="mirror images"):
        HardBatchSampler(CLIPS[::2], 8, Cropping(), HardNegatives(), 0, embed, RarityDraws())


@pytest.mark.parametrize(
    ("start", "frames", "described"), [(0, 40, True), (4, 32, True), (24, 40, False)]
)
def test_a_sentence_describes_the_window_that_it_was_written_for(
    start: int, frames: int, described: bool
) -> None:
    (one,) = [c for c in CLIPS if c.id == "3"]
    assert (
        _describes(spans_of(one)[one.captions[0].text], Crop(one, start, frames, "")) == described
    )
