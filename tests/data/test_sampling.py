from __future__ import annotations

import pytest

from latentmotion.data.clip import Caption, Clip
from latentmotion.data.dataset import Crop, Cropping, items_of, plan_epoch
from latentmotion.errors import InputError


def clip(name: str, frames: int, *captions: Caption) -> Clip:
    return Clip(name, "test", "train", captions, None, False, frames)


CLIPS = [clip(f"{n}", 20 + 3 * n, Caption(f"a{n}", 0, 20 + 3 * n)) for n in range(65)]


def test_parts_with_sentences_are_items_of_their_own() -> None:
    captions = (Caption("a", 0, 90), Caption("b", 20, 60), Caption("c", 0, 90))
    items = items_of([clip("1", 90, *captions), clip("2", 50)])
    assert [(i.start, i.end, i.captions) for i in items] == [
        (0, 90, ("a", "c")),
        (20, 60, ("b",)),
        (0, 50, ()),
    ]


def test_the_plan_depends_on_seed_and_epoch_alone() -> None:
    items = items_of(CLIPS)
    plans = [plan_epoch(items, 8, Cropping(), *seeds) for seeds in ((0, 0), (0, 0), (1, 0), (0, 1))]
    assert plans[0] == plans[1]
    assert plans[0] != plans[2]
    assert plans[0] != plans[3]


def test_crops_fit_their_clips_and_hardly_need_padding() -> None:
    batches = plan_epoch(items_of(CLIPS), 8, Cropping(), 0, 0)
    assert [len(batch) for batch in batches] == [8] * (65 // 8)
    for crop in (crop for batch in batches for crop in batch):
        assert crop.frames % 4 == 0
        assert 8 <= crop.frames <= 196
        assert 0 <= crop.start <= crop.clip.frames - crop.frames
    shown = sum(crop.frames for batch in batches for crop in batch)
    computed = sum(len(batch) * max(crop.frames for crop in batch) for batch in batches)
    assert shown > 0.92 * computed


def test_no_clip_is_shown_twice_in_an_epoch() -> None:
    shown = [c.clip.id for batch in plan_epoch(items_of(CLIPS), 8, Cropping(), 0, 3) for c in batch]
    assert len(shown) == len(set(shown))


def test_fewer_items_than_a_batch_make_one() -> None:
    (batch,) = plan_epoch(items_of(CLIPS[:3]), 8, Cropping(), 0, 0)
    assert len(batch) == 3


def test_a_clip_without_words_has_an_empty_caption() -> None:
    ((crop,),) = plan_epoch(items_of([clip("1", 9)]), 8, Cropping(), 0, 0)
    assert crop == Crop(crop.clip, crop.start, 8, "")


def test_too_short_clips() -> None:
    with pytest.raises(InputError, match="no clip has 8 frames"):
        plan_epoch(items_of([clip("1", 7)]), 8, Cropping(), 0, 0)
