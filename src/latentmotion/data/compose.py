"""Synthetic sequences: two single actions of the train split, one after the other, with sentences.

Which actions fit is decided by the poses at their ends, seen from the body: all places where one
may end and another begin are compared, and only near ones are joined (`splicing.py`). A sequence
whose feet slide or whose joints jerk at the seam more than in real motion is left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.data.captions import mirror_words
from latentmotion.data.clip import Caption, Source
from latentmotion.data.composable import Cut, Part, parts_of_dataset
from latentmotion.data.dataset import Dataset
from latentmotion.data.manifest import COMPOSED, StoredClip
from latentmotion.data.pairing import Pairing, rarity
from latentmotion.data.splicing import seam_of, splice
from latentmotion.data.store import StoredMotion, caption_rows
from latentmotion.describe.ordering import in_order
from latentmotion.errors import DataError
from latentmotion.representation.interface import Representation

_DIP = 0.015
"""Meters that a joint may go below the floor in the transition."""

_ORDERED = 4
"""Sentences about a whole sequence."""

_OWN = 2
"""Sentences about each part of it."""


@dataclass(frozen=True)
class Composition:
    """What sequences are made."""

    count: int
    """How many are wanted."""
    seed: int = 0
    """Source of every choice."""
    seconds: tuple[float, float] = (2.0, 9.8)
    """Shortest and longest sequence."""
    transition: float = 0.4
    """Seconds in which the second motion takes over."""
    distance: float = 0.3
    """Largest distance of poses with their speeds that may be joined, meters."""
    slide: float = 0.3
    """Most that feet on the floor may slide in the transition on average, m/s."""
    jerk: float = 1200.0
    """Most that a joint may jerk in the transition, m/s³."""
    uses: int = 12
    """How often one clip may occur."""
    refused_captions: frozenset[str] = frozenset()
    """Sentences of a test set, as `prompting.plain` writes them, which no caption may be."""


@dataclass(frozen=True)
class Composed:
    """What came of it besides the motions."""

    motions: tuple[StoredMotion, ...]
    """The sequences."""
    source: Source
    """`composed`, with the terms of all owners."""
    refused: Counter[str] = field(default_factory=Counter)
    """How many pairs were left out, by reason."""


def compose(dataset: Dataset, wanted: Composition) -> Composed:
    """Makes sequences of the train split of a prepared folder.

    Args:
        dataset: Clips with captions, in HumanML3D's features.
        wanted: How many, and what is good enough.

    Raises:
        DataError: Too few clips tell of a single action.
    """
    parts = parts_of_dataset(dataset)
    if len(parts) < 2:
        raise DataError(
            f"{dataset.folder}: {len(parts)} train clips tell of a single action, expected at "
            "least 2; add captions (`latentmotion data describe`) or more clips"
        )
    composer = _Composer(dataset, parts, wanted)
    motions = tuple(composer.sequences())
    return Composed(motions, composed_source(dataset.sources), composer.refused)


def composed_source(sources: Sequence[Source]) -> Source:
    """Returns `composed`, with the terms of all owners."""
    return Source(
        name=COMPOSED,
        license="; ".join(dict.fromkeys(source.license for source in sources)),
        credit="synthetic, two clips in a row; "
        + " ".join(f"{s.name}: {s.credit}" for s in sources),
    )


def objection(
    joints: Float[np.ndarray, "frames joints 3"],
    seam: int,
    representation: Representation,
    wanted: Composition,
) -> str:
    """Returns why a sequence is not good enough; empty where it is.

    Args:
        joints: Positions of the whole sequence, meters.
        seam: Frame at which the second motion begins.
        representation: Says the frame rate and the skeleton.
        wanted: What is good enough.
    """
    fps, skeleton = representation.fps, representation.skeleton
    shortest, longest = wanted.seconds
    if not shortest * fps <= len(joints) - 1 <= longest * fps:
        return "too short or too long"
    fit = seam_of(joints, seam, fps, skeleton, round(wanted.transition * fps))
    if fit.lowest < -_DIP:
        return "below the floor"
    if fit.slide > wanted.slide:
        return "feet slide"
    return "jerk" if fit.jerk > wanted.jerk else ""


class _Composer:
    """Draws a first part, finds what may follow, joins and checks."""

    def __init__(self, dataset: Dataset, parts: list[Part], wanted: Composition) -> None:
        self.representation = dataset.representation
        self.parts, self.wanted = parts, wanted
        self.generator = np.random.default_rng(wanted.seed)
        self.rarity = rarity(parts)
        self.pairing = Pairing(parts, dataset.representation, self.generator, wanted.distance)
        self.refused: Counter[str] = Counter()
        self.used: Counter[str] = Counter()
        self.joined: set[tuple[str, str]] = set()

    def sequences(self) -> Iterator[StoredMotion]:
        """Yields sequences until there are enough, or until no more are found."""
        made, in_vain = 0, 0
        while made < self.wanted.count and in_vain < 40 * len(self.parts):
            motion = self._one(made)
            in_vain = 0 if motion else in_vain + 1
            made += motion is not None
            if motion:
                yield motion

    def _one(self, number: int) -> StoredMotion | None:
        first = self.parts[int(self.generator.choice(len(self.parts), p=self.rarity))]
        if self.used[first.name] >= self.wanted.uses:
            return None
        found = self.pairing.follower(first, self._allowed(first))
        if found is None:
            self.refused["no pose near enough"] += 1
            return None
        second, end, start = found
        one, other = first.joints[: end + 1], self._kept(second, start, end)
        joints = splice(one, other, self.wanted.transition, self.representation)
        reason = objection(joints, end, self.representation, self.wanted)
        if reason:
            self.refused[reason] += 1
            return None
        self.used.update((first.name, second.name))
        self.joined.add((first.name, second.name))
        return self._stored(
            number, joints, first.cut(0, end), second.cut(start, start + len(other))
        )

    def _stored(
        self, number: int, joints: Float[np.ndarray, "frames joints 3"], first: Cut, second: Cut
    ) -> StoredMotion:
        """Returns a sequence with its sentences and where it comes from."""
        features = self.representation.encode(joints)
        captions = self._captions(first, second, len(features))
        mirrored = [replace(caption, text=mirror_words(caption.text)) for caption in captions]
        clip = StoredClip(
            id=f"{COMPOSED}-{self.wanted.seed}-{number:05d}",
            source=COMPOSED,
            origin=f"{first.origin} + {second.origin}",
            split="train",
            frames=len(features),
            shard=0,
            offset=0,
            captions=caption_rows(captions),
            mirrored_captions=caption_rows(mirrored),
        )
        return StoredMotion(clip, features)

    def _captions(self, first: Cut, second: Cut, frames: int) -> list[Caption]:
        """Returns sentences about both parts together, then about each of them."""
        seam, generator = first.end - first.start, self.generator
        texts: dict[str, None] = {}
        for _ in range(_ORDERED):
            one, other = (
                cut.part.sentences[int(generator.integers(len(cut.part.sentences)))]
                for cut in (first, second)
            )
            texts.update(dict.fromkeys(in_order(one, other, generator, 1)))
        captions = [Caption(text, 0, frames) for text in texts]
        for cut, (start, end) in ((first, (0, seam)), (second, (seam, frames))):
            captions += [Caption(text, start, end) for text in cut.part.texts[:_OWN]]
        return captions

    def _allowed(self, first: Part) -> Bool[np.ndarray, " parts"]:
        """Says which parts may follow: other actions, not yet joined, not too often used."""
        return np.array(
            [
                part.name != first.name
                and part.verbs != first.verbs
                and (first.name, part.name) not in self.joined
                and self.used[part.name] < self.wanted.uses
                for part in self.parts
            ]
        )

    def _kept(self, second: Part, start: int, before: int) -> Float[np.ndarray, "frames joints 3"]:
        """Returns the second part from its start on, cut where the sequence gets too long."""
        longest = int(self.wanted.seconds[1] * self.representation.fps) - before
        rest = second.joints[start:]
        if second.steady:
            wanted = int(self.generator.integers(second.least, max(len(rest), second.least) + 1))
            return rest[: min(wanted, longest)]
        return rest
