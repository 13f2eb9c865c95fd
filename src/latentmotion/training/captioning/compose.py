"""Synthetic sequences: two single actions of the train split, one after the other, with sentences.

The poses at the ends of actions, seen from the body, decide which ones fit: all frames where one
may end and another begin are compared, and only near ones are joined
(`representation/splicing.py`). A sequence whose feet slide or whose joints jerk at the seam more
than in real motion is left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Caption, Source, mirror_words
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import COMPOSED, StoredClip, StoredMotion, caption_rows
from latentmotion.errors import DataError
from latentmotion.representation.interface import Representation
from latentmotion.representation.splicing import seam_of, splice
from latentmotion.training.captioning.rewording import in_order
from latentmotion.training.captioning.singles import ActionClip, Cut, Pairing, action_clips, rarity

# Meters that a joint may go below the floor in the transition.
_DIP = 0.015

# Sentences about a whole sequence.
_ORDERED = 4

# Sentences about each action in it.
_PER_ACTION = 2


@dataclass(frozen=True)
class Composition:
    """Settings of the sequences to make."""

    count: int
    """Number of sequences."""
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
    """Most sequences that one clip may occur in."""
    refused_captions: frozenset[str] = frozenset()
    """Sentences of a test set, as `language.words.plain` writes them, which no caption may be."""


@dataclass(frozen=True)
class Composed:
    """Synthetic sequences and the reasons why others were refused."""

    motions: tuple[StoredMotion, ...]
    """The sequences."""
    source: Source
    """`composed`, with the terms of all owners."""
    refused: Counter[str] = field(default_factory=Counter)
    """Number of pairs that were left out, by reason."""


def compose(dataset: Dataset, composition: Composition) -> Composed:
    """Makes sequences of the train split of a prepared folder.

    Args:
        dataset: Clips with captions, in HumanML3D's features.
        composition: Number and quality of the sequences.

    Raises:
        DataError: Too few clips describe a single action.
    """
    actions = action_clips(dataset)
    if len(actions) < 2:
        raise DataError(
            f"{dataset.folder}: {len(actions)} train clips tell of a single action, expected at "
            "least 2; add captions (`latentmotion data describe`) or more clips"
        )
    composer = _SequenceComposer(dataset, actions, composition)
    motions: list[StoredMotion] = []
    in_vain = 0
    # Gives up after 40 draws in vain for each action.
    while len(motions) < composition.count and in_vain < 40 * len(actions):
        motion = composer.draw(f"{COMPOSED}-{composition.seed}-{len(motions):05d}")
        in_vain = 0 if motion else in_vain + 1
        motions += [motion] if motion else []
    return Composed(tuple(motions), composed_source(dataset.sources), composer.refused)


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
    limits: Composition,
) -> str:
    """Returns the quality limit that a sequence breaks, or an empty string.

    Args:
        joints: Positions of the whole sequence, meters.
        seam: Frame at which the second motion begins.
        representation: Frame rate and skeleton.
        limits: Required quality.
    """
    fps, skeleton = representation.fps, representation.skeleton
    shortest, longest = limits.seconds
    if not shortest * fps <= len(joints) - 1 <= longest * fps:
        return "too short or too long"
    fit = seam_of(joints, seam, fps, skeleton, round(limits.transition * fps))
    if fit.lowest < -_DIP:
        return "below the floor"
    if fit.slide > limits.slide:
        return "feet slide"
    return "jerk" if fit.jerk > limits.jerk else ""


def composed_motion(
    name: str,
    features: Float[np.ndarray, "frames features"],
    captions: Sequence[Caption],
    origin: str,
) -> StoredMotion:
    """Returns a synthetic sequence with its captions, also in mirrored wording, for training."""
    mirrored = [replace(caption, text=mirror_words(caption.text)) for caption in captions]
    clip = StoredClip(
        id=name,
        source=COMPOSED,
        origin=origin,
        split="train",
        frames=len(features),
        shard=0,
        offset=0,
        captions=caption_rows(captions),
        mirrored_captions=caption_rows(mirrored),
    )
    return StoredMotion(clip, features)


class _SequenceComposer:
    """Draws a first action, finds one that can follow, joins and checks."""

    def __init__(
        self, dataset: Dataset, actions: list[ActionClip], composition: Composition
    ) -> None:
        self.representation = dataset.representation
        self.actions, self.wanted = actions, composition
        self.generator = np.random.default_rng(composition.seed)
        self.rarity = rarity(actions)
        self.pairing = Pairing(actions, self.representation, self.generator, composition.distance)
        self.refused: Counter[str] = Counter()
        self.used: Counter[str] = Counter()
        self.joined: set[tuple[str, str]] = set()

    def draw(self, name: str) -> StoredMotion | None:
        """Returns a sequence, or None where the actions drawn do not fit."""
        composition, representation = self.wanted, self.representation
        first = self.actions[int(self.generator.choice(len(self.actions), p=self.rarity))]
        if self.used[first.name] >= composition.uses:
            return None
        # Other actions, not yet joined, not too often used.
        allowed = [
            action.name != first.name
            and action.verbs != first.verbs
            and (first.name, action.name) not in self.joined
            and self.used[action.name] < composition.uses
            for action in self.actions
        ]
        pair = self.pairing.follower(first, np.array(allowed))
        if pair is None:
            self.refused["no pose near enough"] += 1
            return None
        second, end, start = pair
        following = second.joints[start:]
        if second.steady:  # cut at random, and where the sequence gets too long
            longest = int(composition.seconds[1] * representation.fps) - end
            most = max(len(following), second.fewest)
            frames = int(self.generator.integers(second.fewest, most + 1))
            following = following[: min(frames, longest)]
        joints = splice(first.joints[: end + 1], following, composition.transition, representation)
        reason = objection(joints, end, representation, composition)
        if reason:
            self.refused[reason] += 1
            return None
        self.used.update((first.name, second.name))
        self.joined.add((first.name, second.name))
        cuts = first.cut(0, end), second.cut(start, start + len(following))
        features = representation.encode(joints)
        origin = f"{cuts[0].origin} + {cuts[1].origin}"
        return composed_motion(name, features, self._captions(*cuts, len(features)), origin)

    def _captions(self, first: Cut, second: Cut, frames: int) -> list[Caption]:
        """Returns sentences about both actions together, then about each of them."""
        seam, generator = first.end - first.start, self.generator
        texts: dict[str, None] = {}
        for _ in range(_ORDERED):
            before, after = (
                cut.action.sentences[int(generator.integers(len(cut.action.sentences)))]
                for cut in (first, second)
            )
            texts.update(dict.fromkeys(in_order(before, after, generator, 1)))
        captions = [Caption(text, 0, frames) for text in texts]
        for cut, (start, end) in ((first, (0, seam)), (second, (seam, frames))):
            captions += [Caption(text, start, end) for text in cut.action.texts[:_PER_ACTION]]
        return captions
