"""Windows of single actions: balance, prompts, lengths, seams and crops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.data.dataset import Cropping, Dataset, Item
from latentmotion.errors import DataError
from latentmotion.measure.facts import SingleAction
from latentmotion.training.captioning import singles
from latentmotion.training.captioning.compose import Composition
from latentmotion.training.captioning.compose_actions import Shot, compose_actions
from latentmotion.training.captioning.singles import (
    Balance,
    Found,
    balanced_singles,
    clip_generator,
    single_rows,
)
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


def found(kind: str, count: int, clips: int = 4) -> list[Found]:
    return [Found(f"{n % clips:03d}", SingleAction(kind, n, n + 20)) for n in range(count)]


def test_frequent_actions_are_drawn_over_all_clips_first(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[frozenset[str] | None] = []

    def search(_, seed, clips, kinds=None) -> list[Found]:
        drawn.append(kinds)
        assert {clip.id for clip in clips} <= {f"{n:03d}" for n in range(4)}
        every = [*found("walk", 40), *found("kick", 8), *found("bow", 1)]
        moved = [replace(f, action=replace(f.action, start=f.action.start + seed)) for f in every]
        return [one for one in moved if kinds is None or one.action.kind in kinds]

    monkeypatch.setattr(singles, "find_singles", search)
    kept = balanced_singles(dataset, 0, Balance(most=8, largest=1.0, smallest=0.1))
    counts = {kind: sum(f.action.kind == kind for f in kept) for kind in ("walk", "kick", "bow")}
    assert counts == {"walk": 8, "kick": 8, "bow": 2}, "bow has been drawn anew once"
    assert drawn == [None, frozenset({"bow"})]
    walks = [f.clip for f in kept if f.action.kind == "walk"]
    assert all(walks.count(clip) == 2 for clip in set(walks)) and len(set(walks)) == 4
    few = balanced_singles(dataset, 0, Balance(most=8, largest=0.2, smallest=0.0))
    assert sum(f.action.kind == "walk" for f in few) == int(0.4 * 17)
    assert sum(f.action.kind == "kick" for f in few) == int(0.2 * 17)


def test_generators_of_clips_depend_on_name_and_seed() -> None:
    draws = [clip_generator(*at).random() for at in ((0, "a"), (0, "b"), (1, "a"), (0, "a"))]
    assert len(set(draws)) == 3 and draws[0] == draws[3]


def test_prompts_are_of_their_windows() -> None:
    rows = single_rows(found("jump", 3, clips=2), 0, 2)
    spans = {clip: {(start, end) for _, start, end in each} for clip, each in rows.items()}
    assert spans == {"000": {(0, 20), (2, 22)}, "001": {(1, 21)}}
    assert all("jump" in text or "leap" in text or "hop" in text for each in rows.values()
               for text, *_ in each)  # fmt: skip
    assert single_rows(found("jump", 3, clips=2), 0, 2) == rows


def test_one_kind_of_action_is_too_few_to_compose(dataset: Dataset) -> None:
    with pytest.raises(DataError, match=r"at least 2 kinds .*, found 1; add more"):
        compose_actions(dataset, Composition(4), found("kick", 4))
    with pytest.raises(DataError, match="found 0"):
        compose_actions(dataset, Composition(4), [])


def test_what_is_not_seen_in_a_sequence_is_not_told(dataset: Dataset) -> None:
    """Figures that sway show neither kicks nor bows, whatever they are called."""
    made = compose_actions(dataset, Composition(2), [*found("kick", 4), *found("bow", 4)])
    assert not made.motions and sum(made.refused.values()) > 10
    assert made.source.name == "composed" and "nobody" in made.source.credit


def test_the_best_seam_of_two_shots() -> None:
    def shot(first: list[float], last: list[float]) -> Shot:
        begins, ends = np.array([0, 2]), np.array([7, 9])
        poses = [np.array(each)[:, None] for each in (first, last)]
        return Shot("a", SingleAction("kick", 0, 10), np.zeros((10, 22, 3)), begins, ends, *poses)

    one, other = shot([0.0, 1.0], [5.0, 3.0]), shot([4.5, 9.0], [0.0, 0.0])
    assert one.nearest(other) == (0.5, 7, 0)
    assert other.nearest(one) == (0.0, 7, 0)


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
