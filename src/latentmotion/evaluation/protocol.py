"""Protocols: number and length of motions, captions, groups; the prompts drawn by them.

`Quirks` are peculiarities of the MLD authors' evaluation, each with the section of
docs/reference/mld.md that describes it; all are off by default.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Literal
from zlib import crc32

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Caption, Clip
from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.condition import TASKS, Task, TaskName
from latentmotion.errors import DataError, InputError

ProtocolName = Literal["clean", "paper"]  # Names of the protocols.


@dataclass(frozen=True)
class DrawnPairs:
    """Random pairs in place of all pairs (mld.md §8, §10)."""

    # Pairs of diversity with a text-motion evaluator; each of the two draws without replacement.
    text_diversity: int = 300
    # Pairs of generated motions with an action classifier; with replacement.
    action_diversity: int = 300
    action_multimodality: int = 10  # Pairs of a label, of generated motions.
    true_action_diversity: int = 200  # Pairs of real motions: the default of their function.
    # Pairs of a label, of real motions: the default of their function.
    true_action_multimodality: int = 20
    kid_subsets: int = 100  # Subsets from which KID is averaged (mld.md §8).
    kid_size: int = 1000  # Motions of a subset.


@dataclass(frozen=True)
class Quirks:
    """Switches; False, or None, is the clean way."""

    # Start and length of a clip's crop are drawn anew in every replication, and one in three is a
    # unit shorter (mld.md §5). Clean: from the first frame, as long as it can be.
    random_crops: bool = False
    # One of a clip's captions is drawn (mld.md §5). Clean: they take turns.
    random_captions: bool = False
    # Mirrored copies that the data's authors list in the split are items, too (mld.md §5).
    mirrored_items: bool = False
    # Items beyond the last full group of 32 have no R-precision and MM-Dist (mld.md §8). Clean:
    # others, whose own rank does not count again, fill the last group.
    remainder_dropped: bool = False
    float32_means: bool = False  # FID's means are computed in float32 (mld.md §8).
    # Diversity, MultiModality and KID from random pairs (mld.md §8, §10). Clean: from all.
    drawn_pairs: DrawnPairs | None = None
    # The FID of the ground truth is that to itself in another order, nearly 0 (mld.md §10). Clean:
    # between two random halves, the noise that a set of this size brings.
    permuted_truth: bool = False
    # A VAE repeats a motion from latents drawn of its posterior (mld.md §8). Clean: from the mean.
    sampled_latents: bool = False
    # MPJPE and ACCL sum over the padding of batches of 32 motions, and divide by the number of true
    # frames (mld.md §9).
    padded_sums: bool = False
    # The GRU of the action classifier starts from a random state in every call (mld.md §10).
    random_state: bool = False
    # The deviation of replications is divided by their number (mld.md §8). Clean: by one less.
    population_deviation: bool = False


# All quirks, as in the authors' evaluation.
_SWITCHES: dict[str, Any] = dict.fromkeys((quirk.name for quirk in fields(Quirks)), True)
AUTHORS = Quirks(**{**_SWITCHES, "drawn_pairs": DrawnPairs()})


@dataclass(frozen=True)
class Repeats:
    """Size of MultiModality: many motions of one caption."""

    # Captions, drawn without replacement; all if there are fewer. 0 leaves the metric out.
    texts: int = 100
    samples: int = 10  # Motions of each caption.
    # Pairs of motions that are compared, the same for all captions; null for all pairs.
    pairs: int | None = None
    # Replications that measure it, since it needs the most motions of all metrics.
    replications: int = 5


@dataclass(frozen=True)
class Protocol:
    """Rules of an evaluation."""

    name: str  # Name in reports.
    split: str = "test"  # Split of the test prompts.
    replications: int = 20  # Repetitions of the evaluation with other random numbers.
    seed: int = 0  # All randomness derives from it, the replication and the item.
    group: int = 32  # Motions among which R-precision ranks.
    repeats: Repeats = field(default_factory=Repeats)  # MultiModality of captions.
    max_frames: int | None = None  # Longest motion; by default the model's own.
    # Lengths are multiples of this, as text-motion evaluators see four frames at a time; motions of
    # actions keep their length.
    unit: int = 4
    # Whether the distance to the nearest training clip, which is slow, is measured; in the first
    # replication only.
    nearest_clip: bool = True
    # Peculiarities of the authors' code that are followed.
    quirks: Quirks = field(default_factory=Quirks)

    def __post_init__(self) -> None:
        if self.replications < 1:
            raise InputError(f"{self.replications} replications: expected 1 or more")
        if self.seed < 0 or self.repeats.texts < 0:
            raise InputError(
                f"seed {self.seed}, {self.repeats.texts} captions of many motions: expected 0 or "
                "more"
            )
        if self.group < 2 or self.unit < 1:
            raise InputError(f"group {self.group}, unit {self.unit}: expected 2, 1 or more")

    def generator(self, purpose: str, replication: int, *item: int) -> np.random.Generator:
        """Returns the random generator for a purpose in a replication, or in an item of it."""
        return np.random.default_rng([self.seed, crc32(purpose.encode()), replication, *item])

    def seeds(self, purpose: str, replication: int, count: int, *item: int) -> list[int]:
        """Returns one seed per motion, which depends only on the protocol's seed and its index."""
        start = (self.seed, crc32(purpose.encode()), replication, *item)
        sequences = (np.random.SeedSequence([*start, number]) for number in range(count))
        return [int(sequence.generate_state(1)[0]) for sequence in sequences]


CLEAN = Protocol("clean")  # The default protocol.

# The authors' evaluation, for figures that are compared with those of papers.
PAPER = Protocol(
    "paper", repeats=Repeats(texts=100, samples=30, pairs=10, replications=20), quirks=AUTHORS
)

PROTOCOLS: dict[ProtocolName, Protocol] = {"clean": CLEAN, "paper": PAPER}  # Protocols by name.


# Representations of poses, whose last frame can be repeated if a clip is too short.
HELD = ("smpl",)


@dataclass(frozen=True)
class TestItem:
    """A clip, or a part of one, with the captions of exactly that part."""

    __test__ = False

    clip: Clip  # The clip.
    start: int  # First frame.
    end: int  # One past the last frame.
    captions: tuple[Caption, ...]  # Captions; empty if they are not needed.


@dataclass(frozen=True)
class Lengths:
    """Lengths of the motions of a test set, in frames."""

    shortest: int  # Shorter items are left out, or held at their last frame.
    longest: int  # Longest crop.
    unit: int  # Lengths are multiples of this.
    held: bool = False  # Whether short items are held.

    def of(self, item: TestItem) -> int:
        """Returns the greatest length that an item gives."""
        frames = min(item.end - item.start, self.longest) // self.unit * self.unit
        return max(frames, self.shortest) if self.held else frames


@dataclass(frozen=True, eq=False)
class TestPrompt:
    """An item in one replication: its crop and one of its captions."""

    __test__ = False

    item: TestItem  # The item.
    start: int  # First frame of the crop.
    frames: int  # Length of the crop.
    caption: Caption | None  # The caption, if there is one.

    def text(self, task: Task) -> str:
        """Returns the prompt for a model of a task."""
        return task.question(self.caption.text if self.caption else "", self.item.clip.action)


@dataclass(frozen=True, eq=False)
class Replication:
    """One replication: its test prompts, and the real motions that answer them."""

    number: int  # Its number, from 0.
    prompts: tuple[TestPrompt, ...]  # One per item.
    features: list[Float[np.ndarray, "_ features"]]  # The real motions, in their own units.

    @property
    def frames(self) -> list[int]:
        """Length of each motion."""
        return [prompt.frames for prompt in self.prompts]


@dataclass(frozen=True)
class TestSet:
    """The items of a split, and their test prompts in every replication."""

    __test__ = False

    dataset: Dataset  # Source of prompts and real motions.
    protocol: Protocol  # Rules of the choice.
    needs: TaskName  # Task whose prompts clips must have: captions, a label, or nothing.
    lengths: Lengths  # Lengths of the motions.

    @cached_property
    def clips(self) -> list[Clip]:
        """Clips of the split."""
        clips, split = self.dataset.clips(self.protocol.split), self.protocol.split
        listed = self.protocol.quirks.mirrored_items
        return [*clips, *self.dataset.mirrored_copies(split)] if listed else clips

    @cached_property
    def items(self) -> list[TestItem]:
        """Items of the split that are long enough.

        Raises:
            DataError: There are fewer than two.
        """
        split, shortest = self.protocol.split, self.lengths.shortest
        items: list[TestItem] = []
        for clip in self.clips:
            if self.needs == "text":  # an item per captioned part
                parts: dict[tuple[int, int], list[Caption]] = {}
                for caption in clip.captions:
                    parts.setdefault((caption.start_frame, caption.end_frame), []).append(caption)
                items += [TestItem(clip, *part, tuple(group)) for part, group in parts.items()]
            elif self.needs != "action" or clip.action:
                items.append(TestItem(clip, 0, clip.frames, ()))
        usable = [item for item in items if self.lengths.of(item) >= max(shortest, 1)]
        if len(usable) < 2:
            raise DataError(
                f"{self.dataset.folder} has {len(usable)} clips {TASKS[self.needs].asks_for} of "
                f"{shortest} frames or more in its {split} split, expected at least 2; take "
                "another split or data set"
            )
        return usable

    def replication(self, number: int) -> Replication:
        """Returns the test prompts of a replication and their real motions."""
        lengths, quirks = self.lengths, self.protocol.quirks
        prompts, features = [], []
        for index, item in enumerate(self.items):
            # Crop and caption are drawn, or taken in turn.
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
            prompt = TestPrompt(item, start, frames, caption)
            prompts.append(prompt)
            rows = np.minimum(prompt.start + np.arange(prompt.frames), prompt.item.end - 1)
            crop = self.dataset.features(prompt.item.clip)[rows]
            features.append(self.dataset.representation.restart(crop))
        return Replication(number, tuple(prompts), features)
