"""What a replication asks: which part of which clip, told by which sentence or label."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.condition.task import TASKS, Task, TaskName
from latentmotion.data.clip import Caption, Clip
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError
from latentmotion.evaluation.settings import Protocol

HELD = ("smpl",)
"""Representations of poses, whose last frame can be repeated where a clip is too short."""


@dataclass(frozen=True)
class TestItem:
    """A clip, or the part of one, with the sentences that tell of exactly that."""

    __test__ = False

    clip: Clip
    """The clip."""
    start: int
    """First frame."""
    end: int
    """One past the last frame."""
    captions: tuple[Caption, ...]
    """Sentences; none where they are not needed."""


@dataclass(frozen=True)
class Lengths:
    """Which lengths are asked for."""

    shortest: int
    """Shorter items are left out, or held at their last frame."""
    longest: int
    """Longest crop."""
    unit: int
    """Lengths are multiples of this."""
    held: bool = False
    """Whether short items are held."""

    def of(self, item: TestItem) -> int:
        """Returns the greatest length that an item gives."""
        frames = min(item.end - item.start, self.longest) // self.unit * self.unit
        return max(frames, self.shortest) if self.held else frames


@dataclass(frozen=True, eq=False)
class Question:
    """One item as it is asked in one replication."""

    item: TestItem
    """The item."""
    start: int
    """First frame of the crop."""
    frames: int
    """Its length."""
    caption: Caption | None
    """The sentence, where there is one."""

    def prompt(self, task: Task) -> str:
        """Returns what a model of a task is asked."""
        return task.question(self.caption.text if self.caption else "", self.item.clip.action)


@dataclass(frozen=True, eq=False)
class Trial:
    """One replication: its questions, and the real motions that answer them."""

    replication: int
    """Its number."""
    questions: tuple[Question, ...]
    """One per item."""
    features: list[Float[np.ndarray, "_ features"]]
    """The real motions, in their own units."""

    @property
    def frames(self) -> list[int]:
        """Length of each motion."""
        return [question.frames for question in self.questions]


@dataclass(frozen=True)
class Plan:
    """What a split is asked for in every replication."""

    dataset: Dataset
    """Where questions and real motions come from."""
    protocol: Protocol
    """How they are chosen."""
    needs: TaskName
    """What clips must have to be asked for: sentences, a label, or nothing."""
    lengths: Lengths
    """Which lengths are asked for."""

    @cached_property
    def items(self) -> list[TestItem]:
        """What can be asked for.

        Raises:
            DataError: There are fewer than two.
        """
        split, shortest = self.protocol.split, self.lengths.shortest
        items = [item for clip in self.dataset.clips(split) for item in _ITEMS[self.needs](clip)]
        kept = [item for item in items if self.lengths.of(item) >= max(shortest, 1)]
        if len(kept) < 2:
            raise DataError(
                f"{self.dataset.folder} has {len(kept)} clips {TASKS[self.needs].asks_for} of "
                f"{shortest} frames or more in its {split} split, expected at least 2; take "
                "another split or data set"
            )
        return kept

    def trial(self, replication: int) -> Trial:
        """Returns the questions of a replication and their real answers."""
        questions = tuple(
            _question(item, number, self.lengths, self.protocol, replication)
            for number, item in enumerate(self.items)
        )
        features = [_crop(self.dataset, question) for question in questions]
        return Trial(replication, questions, features)


def _question(
    item: TestItem, number: int, lengths: Lengths, protocol: Protocol, replication: int
) -> Question:
    generator = protocol.generator("crops", replication, number)
    frames, start, turn = lengths.of(item), item.start, replication
    if protocol.quirks.random_crops:
        shorter = frames - lengths.unit
        if lengths.unit > 1 and generator.random() < 1 / 3 and shorter >= lengths.shortest:
            frames = shorter
        start += int(generator.integers(max(item.end - item.start - frames, 0) + 1))
    if protocol.quirks.random_captions:
        turn = int(generator.integers(max(len(item.captions), 1)))
    caption = item.captions[turn % len(item.captions)] if item.captions else None
    return Question(item, start, frames, caption)


def _crop(dataset: Dataset, question: Question) -> Float[np.ndarray, "frames features"]:
    rows = question.start + np.arange(question.frames)
    part = dataset.features(question.item.clip)[np.minimum(rows, question.item.end - 1)]
    return dataset.representation.restart(part)


def _captioned(clip: Clip) -> list[TestItem]:
    spans: dict[tuple[int, int], list[Caption]] = {}
    for caption in clip.captions:
        spans.setdefault((caption.start_frame, caption.end_frame), []).append(caption)
    return [TestItem(clip, start, end, tuple(group)) for (start, end), group in spans.items()]


def _whole(clip: Clip) -> list[TestItem]:
    return [TestItem(clip, 0, clip.frames, ())]


def _labelled(clip: Clip) -> list[TestItem]:
    return _whole(clip) if clip.action else []


_ITEMS = {"text": _captioned, "action": _labelled, "unconditional": _whole}
