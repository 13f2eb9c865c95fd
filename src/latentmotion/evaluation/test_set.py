"""Test prompts of each replication: a part of a clip with its caption, label or length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.condition.task import TASKS, Task, TaskName
from latentmotion.data.clip import Caption, Clip
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError
from latentmotion.evaluation.protocol import Protocol

HELD = ("smpl",)
"""Representations of poses, whose last frame can be repeated if a clip is too short."""


@dataclass(frozen=True)
class TestItem:
    """A clip, or a part of one, with the captions of exactly that part."""

    __test__ = False

    clip: Clip
    """The clip."""
    start: int
    """First frame."""
    end: int
    """One past the last frame."""
    captions: tuple[Caption, ...]
    """Captions; empty if they are not needed."""


@dataclass(frozen=True)
class Lengths:
    """Lengths of the motions of a test set, in frames."""

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
class TestPrompt:
    """An item in one replication: its crop and one of its captions."""

    __test__ = False

    item: TestItem
    """The item."""
    start: int
    """First frame of the crop."""
    frames: int
    """Length of the crop."""
    caption: Caption | None
    """The caption, if there is one."""

    def text(self, task: Task) -> str:
        """Returns the prompt for a model of a task."""
        return task.question(self.caption.text if self.caption else "", self.item.clip.action)


@dataclass(frozen=True, eq=False)
class Replication:
    """One replication: its test prompts, and the real motions that answer them."""

    number: int
    """Its number, from 0."""
    prompts: tuple[TestPrompt, ...]
    """One per item."""
    features: list[Float[np.ndarray, "_ features"]]
    """The real motions, in their own units."""

    @property
    def frames(self) -> list[int]:
        """Length of each motion."""
        return [prompt.frames for prompt in self.prompts]


@dataclass(frozen=True)
class TestSet:
    """The items of a split, and their test prompts in every replication."""

    __test__ = False

    dataset: Dataset
    """Source of prompts and real motions."""
    protocol: Protocol
    """Rules of the choice."""
    needs: TaskName
    """Task whose prompts clips must have: captions, a label, or nothing."""
    lengths: Lengths
    """Lengths of the motions."""

    @cached_property
    def items(self) -> list[TestItem]:
        """Items of the split that are long enough.

        Raises:
            DataError: There are fewer than two.
        """
        split, shortest = self.protocol.split, self.lengths.shortest
        items = [item for clip in self.dataset.clips(split) for item in _items(clip, self.needs)]
        kept = [item for item in items if self.lengths.of(item) >= max(shortest, 1)]
        if len(kept) < 2:
            raise DataError(
                f"{self.dataset.folder} has {len(kept)} clips {TASKS[self.needs].asks_for} of "
                f"{shortest} frames or more in its {split} split, expected at least 2; take "
                "another split or data set"
            )
        return kept

    def replication(self, number: int) -> Replication:
        """Returns the test prompts of a replication and their real motions."""
        prompts = tuple(self._prompt(index, item, number) for index, item in enumerate(self.items))
        features = []
        for prompt in prompts:
            rows = np.minimum(prompt.start + np.arange(prompt.frames), prompt.item.end - 1)
            crop = self.dataset.features(prompt.item.clip)[rows]
            features.append(self.dataset.representation.restart(crop))
        return Replication(number, prompts, features)

    def _prompt(self, index: int, item: TestItem, number: int) -> TestPrompt:
        """Draws, or takes in turn, the crop and the caption of an item in a replication."""
        lengths, quirks = self.lengths, self.protocol.quirks
        generator = self.protocol.generator("crops", number, index)
        frames, start, turn = lengths.of(item), item.start, number
        if quirks.random_crops:
            shorter = frames - lengths.unit
            if lengths.unit > 1 and generator.random() < 1 / 3 and shorter >= lengths.shortest:
                frames = shorter
            start += int(generator.integers(max(item.end - item.start - frames, 0) + 1))
        if quirks.random_captions:
            turn = int(generator.integers(max(len(item.captions), 1)))
        caption = item.captions[turn % len(item.captions)] if item.captions else None
        return TestPrompt(item, start, frames, caption)


def _items(clip: Clip, needs: TaskName) -> list[TestItem]:
    """Returns one item per captioned part of a clip, or the whole clip for other tasks."""
    if needs != "text":
        return [TestItem(clip, 0, clip.frames, ())] if needs != "action" or clip.action else []
    parts: dict[tuple[int, int], list[Caption]] = {}
    for caption in clip.captions:
        parts.setdefault((caption.start_frame, caption.end_frame), []).append(caption)
    return [TestItem(clip, start, end, tuple(group)) for (start, end), group in parts.items()]
