"""Synthetic sequences: two single actions of the train split, one after the other, with sentences.

The poses at the ends of actions, seen from the body, decide which ones fit: all frames where one
may end and another begin are compared, and only near ones are joined
(`representation/splicing.py`). A sequence whose feet slide or whose joints jerk at the seam more
than in real motion is left out. A clip, or a part of one, counts as a single action if plain
sentences describe it as one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.data.clip import Caption, Clip, Source, mirror_words
from latentmotion.data.dataset import Dataset, items_of
from latentmotion.data.store import COMPOSED, StoredClip, StoredMotion, caption_rows
from latentmotion.errors import DataError
from latentmotion.kinematics.skeleton import Joints, Skeleton
from latentmotion.representation.canonical import heading
from latentmotion.representation.interface import Representation
from latentmotion.representation.splicing import pose_descriptors, seam_of, splice
from latentmotion.training.captioning.clauses import Sentence, read_clauses, word_set
from latentmotion.training.captioning.rewording import in_order

# Meters that a joint may go below the floor in the transition.
_DIP = 0.015

# Sentences about a whole sequence.
_ORDERED = 4

# Sentences about each action in it.
_PER_ACTION = 2


@dataclass(frozen=True)
class Composition:
    """Settings of the sequences to make."""

    count: int  # Number of sequences.
    seed: int = 0  # Source of every choice.
    seconds: tuple[float, float] = (2.0, 9.8)  # Shortest and longest sequence.
    transition: float = 0.4  # Seconds in which the second motion takes over.
    distance: float = 0.3  # Largest distance of poses with their speeds that may be joined, meters.
    slide: float = 0.3  # Most that feet on the floor may slide in the transition on average, m/s.
    jerk: float = 1200.0  # Most that a joint may jerk in the transition, m/s³.
    uses: int = 12  # Most sequences that one clip may occur in.


@dataclass(frozen=True)
class Composed:
    """Synthetic sequences and the reasons why others were refused."""

    motions: tuple[StoredMotion, ...]  # The sequences.
    source: Source  # `composed`, with the terms of all owners.
    # Number of pairs that were left out, by reason.
    refused: Counter[str] = field(default_factory=Counter)


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
    joints: Joints, seam: int, representation: Representation, limits: Composition
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
        self.pairing = Pairing(actions, self.representation, self.generator, composition.distance)
        self.refused: Counter[str] = Counter()
        self.used: Counter[str] = Counter()
        self.joined: set[tuple[str, str]] = set()

    def draw(self, name: str) -> StoredMotion | None:
        """Returns a sequence, or None where the actions drawn do not fit."""
        composition, representation = self.wanted, self.representation
        first = self.actions[int(self.generator.choice(len(self.actions), p=self.pairing.rarity))]
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
        cuts = Cut(first, 0, end), Cut(second, start, start + len(following))
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


# Frames at which an action may end, and as many at which it may begin.
_SEAMS = 8

# Shortest and longest single action; steady movements are cut.
_FRAMES = (12, 130)

# Words of the longest sentence about an action.
_WORDS = 14

# Shortest piece of a steady movement.
_STEADY_FRAMES = 24

# Most frames, and most of its length, that an action loses at either end for a better seam.
_TRIMMED = (8, 0.12)

# Meters; some recordings have a bone without length, which gives it no direction.
_SHORTEST_BONE = 0.005

# Share of the greatest speed of a limb that an action has where it is cut in two.
_BROKEN_OFF = 0.9

_GOING = word_set("going")
_GOING_OR_STANDING = _GOING | {"stand"}
_STEADY = _GOING | {"stand", "dance", "swim", "dribble"}
_ENDING, _QUALIFYING, _REFERRING = word_set("ending"), word_set("qualifying"), word_set("referring")


@dataclass(frozen=True, eq=False)
class ActionClip:
    """A clip, or a captioned part of one, that shows a single action."""

    clip: Clip  # The clip, or its mirrored copy.
    start: int  # Its first frame there.
    joints: Joints  # Positions, meters, the floor at height 0.
    sentences: tuple[Sentence, ...]  # Its captions, in clauses; at least one.
    texts: tuple[str, ...]  # The same sentences as they were written.
    steady: bool  # Whether any piece of it is the same action.

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.clip.id

    @property
    def verbs(self) -> frozenset[str]:
        """Verbs and qualifying words of its first sentence."""
        clauses = self.sentences[0].clauses
        words = {word for clause in clauses for word in (*clause.rest, *clause.before)}
        return frozenset({clause.verb for clause in clauses} | (words & _QUALIFYING))

    @property
    def slack(self) -> int:
        """Frames that it may lose at either end."""
        return min(_TRIMMED[0], int(_TRIMMED[1] * len(self.joints)))

    @property
    def fewest(self) -> int:
        """Fewest frames that it may be cut to."""
        return min(_STEADY_FRAMES, len(self.joints) - 1) if self.steady else len(self.joints)


@dataclass(frozen=True, eq=False)
class Cut:
    """A piece of an action clip."""

    action: ActionClip  # The action clip.
    start: int  # First frame, counted from the action clip's.
    end: int  # One past the last frame.

    @property
    def origin(self) -> str:
        """Clip, frames at the data set's rate, and the recording that the clip was cut from."""
        clip, shift = self.action.clip, self.action.start
        return f"{clip.id}[{self.start + shift}:{self.end + shift}] ({clip.source} {clip.origin})"


def action_clips(dataset: Dataset) -> list[ActionClip]:
    """Returns the single actions of the train split and their mirror images."""
    representation = dataset.representation
    skeleton = representation.skeleton
    parents = [max(parent, 0) for parent in skeleton.parents]
    clips = [
        c for c in dataset.clips("train", mirrored=True) if c.captions and c.source != COMPOSED
    ]
    actions = []
    for item in items_of(clips):
        read = [(sentence, text) for text in item.captions if (sentence := _single_action(text))]
        if not read or 3 * len(read) < len(item.captions) or item.frames < _FRAMES[0]:
            continue
        joints = representation.decode(dataset.features(item.clip)[item.start : item.end])
        bones = np.linalg.norm(joints - joints[:, parents], axis=-1)[:, 1:]
        if bones.min() < _SHORTEST_BONE:
            continue
        joints = representation.retarget(joints)  # a mirrored copy has the other side's bones
        sentences, texts = zip(*read, strict=True)
        steady = _is_steady(sentences, joints, skeleton)
        if steady or (item.frames <= _FRAMES[1] and not _is_broken_off(sentences, joints)):
            actions.append(ActionClip(item.clip, item.start, joints, sentences, texts, steady))
    return actions


def rarity(actions: Sequence[ActionClip]) -> Float[np.ndarray, " actions"]:
    """Returns weights by which actions are drawn, so that frequent ones do not dominate."""
    frequency = Counter(action.verbs for action in actions)
    # Between draws by frequency (exponent 0) and all verbs alike (-1): rare verbs have few clips,
    # which would repeat.
    weights = np.array([frequency[action.verbs] ** -0.7 for action in actions])
    return weights / weights.sum()


class Pairing:
    """Finds actions that begin nearly as another ends.

    Args:
        actions: Candidates.
        representation: Frame rate and skeleton.
        generator: Source of every choice.
        distance: Largest distance of poses with their speeds, meters.
    """

    def __init__(
        self,
        actions: Sequence[ActionClip],
        representation: Representation,
        generator: np.random.Generator,
        distance: float,
    ) -> None:
        self.actions, self.representation = actions, representation
        self.generator, self.distance, self.rarity = generator, distance, rarity(actions)
        owners, frames, poses = [], [], []
        for index, action in enumerate(actions):
            # Early frames, or any of a steady movement.
            latest = len(action.joints) - 1 - action.fewest if action.steady else action.slack
            starts = self._some_frames(0, max(latest, 0))
            owners.append(np.full(len(starts), index))
            frames.append(starts)
            poses.append(self._poses(action, starts))
        self.owners = np.concatenate(owners)
        self.poses = np.concatenate(poses).astype(np.float32)
        self.frames = np.concatenate(frames)

    def follower(
        self, first: ActionClip, allowed: Bool[np.ndarray, " actions"]
    ) -> tuple[ActionClip, int, int] | None:
        """Returns a second action, the frame at which the first ends and at which it begins.

        Args:
            first: The first action.
            allowed: Whether each action may follow.
        """
        last = len(first.joints) - 1
        # Late frames, or any of a steady movement.
        ends = self._some_frames(first.fewest if first.steady else last - first.slack, last)
        poses = self._poses(first, ends).astype(np.float32)
        squares = (poses**2).sum(1)[:, None] + (self.poses**2).sum(1) - 2 * poses @ self.poses.T
        distance = np.sqrt(np.maximum(squares, 0))
        distance[:, ~allowed[self.owners]] = np.inf
        best = np.full(len(self.actions), np.inf)
        np.minimum.at(best, self.owners, distance.min(axis=0))
        near = np.flatnonzero(best < self.distance)
        if not len(near):
            return None
        # Users ask most for "walk, then ..." and "..., then walk".
        going = np.array([bool(self.actions[n].verbs & _GOING_OR_STANDING) for n in near.tolist()])
        preference = np.where(going != bool(first.verbs & _GOING_OR_STANDING), 4.0, 1.0)
        weights = preference * self.rarity[near] / (0.05 + best[near])
        chosen = int(self.generator.choice(near, p=weights / weights.sum()))
        columns = np.flatnonzero(self.owners == chosen)
        row, column = np.unravel_index(distance[:, columns].argmin(), (len(ends), len(columns)))
        return self.actions[chosen], int(ends[row]), int(self.frames[columns[column]])

    def _some_frames(self, first: int, last: int) -> Int[np.ndarray, " chosen"]:
        frames = np.arange(first, last + 1)
        if len(frames) > _SEAMS:
            frames = np.sort(self.generator.choice(frames, _SEAMS, replace=False))
        return frames

    def _poses(
        self, action: ActionClip, frames: Int[np.ndarray, " chosen"]
    ) -> Float[np.ndarray, "chosen numbers"]:
        representation = self.representation
        return pose_descriptors(action.joints, representation.fps, representation.skeleton, frames)


def _single_action(text: str) -> Sentence | None:
    """Reads a sentence about a single action; None where it describes more, or less."""
    sentence = read_clauses(text)
    if sentence is None or sentence.referring or len(sentence.clauses) > 2:
        return None
    words = text.lower().replace(".", "").split()
    ordered = any(clause.link in ("then", ".", ",") for clause in sentence.clauses)
    plain = len(words) <= _WORDS and not _REFERRING & set(words[:-1]) and "," not in text
    return sentence if plain and not ordered else None


def _is_broken_off(sentences: tuple[Sentence, ...], joints: Joints) -> bool:
    """Whether limbs are fastest where the clip ends, as in a kick that is cut at its height."""
    if any(clause.verb in _GOING for sentence in sentences for clause in sentence.clauses):
        return False
    steps = np.linalg.norm(np.diff(joints - joints[:, :1], axis=0), axis=-1).max(axis=1)
    speeds = np.convolve(steps, np.full(3, 1 / 3), "valid")
    return bool(speeds[-1] > _BROKEN_OFF * speeds.max())


def _is_steady(sentences: tuple[Sentence, ...], joints: Joints, skeleton: Skeleton) -> bool:
    """Whether a movement is uniform: by its words, and when going by speed and heading."""
    verbs = {clause.verb for sentence in sentences for clause in sentence.clauses}
    words = {word for sentence in sentences for c in sentence.clauses for word in c.rest}
    if not verbs <= _STEADY or words & _ENDING or len(joints) < 2 * _STEADY_FRAMES:
        return False
    if not verbs & _GOING:
        return True
    thirds = np.array_split(joints, 3)
    speeds = np.array([np.linalg.norm((t[-1, 0] - t[0, 0])[::2]) / len(t) for t in thirds])
    facing = np.unwrap(np.asarray(heading(joints, skeleton)))
    return bool(speeds.min() > 0.6 * speeds.mean() and np.ptp(facing) < np.radians(60))
