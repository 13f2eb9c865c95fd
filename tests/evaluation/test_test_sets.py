"""Which parts of clips are asked for, how long, and with which caption."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.data.clip import Caption, Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import CaptionRow, StoredClip
from latentmotion.diffusion.condition import ActionTask, TaskName, TextTask, UnconditionalTask
from latentmotion.errors import DataError, InputError
from latentmotion.evaluation.protocol import (
    CLEAN,
    PAPER,
    Lengths,
    Protocol,
    Quirks,
    Repeats,
    TestItem,
    TestPrompt,
    TestSet,
)
from tests.support.moving_figures import write_moving_figures

LENGTHS = Lengths(8, 40, 4)
ON_VAL = replace(CLEAN, split="val")


@pytest.fixture(scope="module")
def figures_of_val(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("data") / "figures"
    return Dataset.load(write_moving_figures(folder, train=1, val=3))


def captioned(dataset: Dataset, *rows: tuple[CaptionRow, ...]) -> Dataset:
    """Returns the data set with other captions for the first clips of val."""
    clips: list[StoredClip] = []
    left = list(rows)
    for clip in dataset.manifest.clips:
        change = clip.split == "val" and left
        clips.append(replace(clip, captions=left.pop(0)) if change else clip)
    return replace(dataset, manifest=replace(dataset.manifest, clips=tuple(clips)))


def item(frames: int, start: int = 0) -> TestItem:
    clip = Clip("a", "made up", "test", (), None, False, start + frames)
    return TestItem(clip, start, start + frames, ())


@pytest.mark.parametrize(
    ("frames", "lengths", "expected"),
    [
        (7, LENGTHS, 4),
        (23, LENGTHS, 20),
        (24, LENGTHS, 24),
        (99, LENGTHS, 40),
        (99, Lengths(8, 43, 4), 40),
        (5, Lengths(8, 40, 1), 5),
        (5, Lengths(8, 40, 1, held=True), 8),
        (99, Lengths(60, 60, 1, held=True), 60),
    ],
)
def test_lengths_are_multiples_up_to_the_longest(
    frames: int, lengths: Lengths, expected: int
) -> None:
    assert lengths.of(item(frames, start=11)) == expected


@pytest.mark.parametrize(
    ("needs", "spans"),
    [
        ("text", [(0, 20), (4, 24)]),
        ("action", [(0, None)]),
        ("unconditional", [(0, None)]),
    ],
)
def test_captioned_parts_are_items_where_captions_are_needed(
    figures_of_val: Dataset, needs: TaskName, spans: list[tuple[int, int | None]]
) -> None:
    rows = (("a", 0, 20, ""), ("b", 4, 24, ""), ("c", 0, 20, ""))
    dataset = captioned(figures_of_val, rows)
    items = TestSet(dataset, ON_VAL, needs, LENGTHS).items
    first = [one for one in items if one.clip.id == items[0].clip.id]
    assert [(one.start, one.end) for one in first] == [
        (start, end or items[0].clip.frames) for start, end in spans
    ]
    texts = [[caption.text for caption in one.captions] for one in first]
    assert texts == ([["a", "c"], ["b"]] if needs == "text" else [[]])


def test_clips_without_a_label_are_no_actions(figures_of_val: Dataset) -> None:
    stored = figures_of_val.manifest.clips
    clips = (*stored[:-1], replace(stored[-1], action=None))
    dataset = replace(figures_of_val, manifest=replace(figures_of_val.manifest, clips=clips))
    counts = [len(TestSet(dataset, ON_VAL, n, LENGTHS).items) for n in ("action", "unconditional")]
    assert counts == [2, 3]


@pytest.mark.parametrize(
    ("protocol", "needs", "lengths", "message"),
    [
        (CLEAN, "text", LENGTHS, "has 0 clips with captions of 8 frames or more in its test split"),
        (ON_VAL, "action", Lengths(400, 800, 4), "has 0 clips with a label of 400 frames"),
        (
            ON_VAL,
            "unconditional",
            Lengths(400, 800, 4),
            "0 clips of any kind .*, expected at least",
        ),
    ],
)
def test_too_few_items(
    figures_of_val: Dataset, protocol: Protocol, needs: TaskName, lengths: Lengths, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        _ = TestSet(figures_of_val, protocol, needs, lengths).items


def test_captions_take_turns_or_are_drawn(figures_of_val: Dataset) -> None:
    dataset = captioned(figures_of_val, tuple((name, 0, 24, "") for name in "abc"))
    clean = TestSet(dataset, ON_VAL, "text", LENGTHS)
    drawn = replace(clean, protocol=replace(ON_VAL, quirks=Quirks(random_captions=True)))
    told = {}
    for name, test_set in (("clean", clean), ("drawn", drawn)):
        captions = [test_set.replication(number).prompts[0].caption for number in range(12)]
        told[name] = "".join(caption.text for caption in captions if caption)
    assert told["clean"] == "abcabcabcabc"
    assert told["drawn"] != told["clean"] and set(told["drawn"]) == set("abc")


def test_crops_start_anywhere_that_leaves_them_whole(figures_of_val: Dataset) -> None:
    protocol = replace(ON_VAL, quirks=Quirks(random_crops=True))
    lengths = Lengths(8, 16, 4)
    test_set = TestSet(figures_of_val, protocol, "text", lengths)
    prompts = [one for number in range(30) for one in test_set.replication(number).prompts]
    assert {prompt.frames for prompt in prompts} == {12, 16}
    assert all(0 <= p.start <= p.item.end - p.frames for p in prompts)
    assert len({prompt.start for prompt in prompts}) > 8


def test_the_real_motions_are_the_crops(figures_of_val: Dataset) -> None:
    dataset = captioned(figures_of_val, (("a", 5, 20, ""),))
    replication = TestSet(dataset, ON_VAL, "text", LENGTHS).replication(0)
    assert replication.frames == [len(features) for features in replication.features]
    prompt, features = replication.prompts[0], replication.features[0]
    assert (prompt.start, prompt.frames) == (5, 12)
    whole = dataset.features(prompt.item.clip)
    poses = dataset.representation.blocks["positions"]
    np.testing.assert_array_equal(features[:, poses], whole[5:17, poses])


def test_short_clips_are_held_at_their_last_frame(figures_of_val: Dataset) -> None:
    held = Lengths(90, 90, 1, held=True)
    replication = TestSet(figures_of_val, ON_VAL, "unconditional", held).replication(0)
    for prompt, features in zip(replication.prompts, replication.features, strict=True):
        rest = features[prompt.item.clip.frames - 1 :]
        assert len(features) == 90 and len(rest) > 20
        np.testing.assert_array_equal(rest, np.repeat(rest[:1], len(rest), axis=0))


@pytest.mark.parametrize(
    ("task", "caption", "action", "expected"),
    [
        (TextTask(), Caption("he walks", 0, 8), "walk", "he walks"),
        (TextTask(), None, "walk", ""),
        (ActionTask(("walk",)), Caption("he walks", 0, 8), "walk", "walk"),
        (ActionTask(("walk",)), Caption("he walks", 0, 8), None, ""),
        (UnconditionalTask(), Caption("he walks", 0, 8), "walk", ""),
    ],
)
def test_prompts_are_what_the_task_reads(task, caption, action, expected: str) -> None:
    clip = Clip("a", "made up", "test", (), action, False, 8)
    assert TestPrompt(TestItem(clip, 0, 8, ()), 0, 8, caption).text(task) == expected


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"replications": 0}, "0 replications: expected 1"),
        ({"seed": -1}, "seed -1, 100 captions"),
        ({"repeats": Repeats(texts=-2)}, "seed 0, -2 captions"),
        ({"group": 1}, "group 1, unit 4"),
        ({"unit": 0}, "group 32, unit 0"),
    ],
)
def test_protocols_that_cannot_be(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(CLEAN, **changes)


def test_seeds_are_of_purpose_replication_and_item() -> None:
    seeds = PAPER.seeds("motions", 0, 5)
    assert PAPER.seeds("motions", 0, 9)[:5] == seeds
    others = [
        PAPER.seeds("repeats", 0, 5),
        PAPER.seeds("motions", 1, 5),
        PAPER.seeds("motions", 0, 5, 7),
        replace(PAPER, seed=1).seeds("motions", 0, 5),
    ]
    assert len({*seeds, *(seed for other in others for seed in other)}) == 25
    assert CLEAN.seeds("motions", 0, 5) == seeds
    draws = [CLEAN.generator("crops", *at).random() for at in ((0,), (1,), (0, 1), (0, 2))]
    assert len(set(draws)) == 4
