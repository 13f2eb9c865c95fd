"""Single actions of a data set: windows that show them, and which can follow which.

Frequent categories are subsampled, over different clips first; kinds with few windows are shown in
several windows with other margins.

A clip, or a part of one, counts as a single action if plain sentences describe it as one. The poses
at the ends of all of them are compared as seen from the body.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset, items_of
from latentmotion.data.store import COMPOSED, StoredClip
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.measure.facts import SingleAction
from latentmotion.representation.canonical import heading
from latentmotion.representation.interface import Representation
from latentmotion.representation.splicing import pose_descriptors
from latentmotion.training.captioning.clauses import Sentence, read_clauses, word_set
from latentmotion.training.captioning.prompting import prompts
from latentmotion.training.captioning.single_actions import single_actions

Category = tuple[str, ...]
"""Kind, side, direction, count, degrees and pace of an action; left and right are one."""

# Kinds that may have twice the share of others.
_LARGE = ("walk", "turn")

# Times that windows are drawn again for kinds that have few.
_DRAWS = 8


@dataclass(frozen=True)
class Balance:
    """Limits on the number of windows of a category or kind."""

    most: int = 40
    """Windows of one category."""
    largest: float = 0.055
    """Largest share of one kind; walking and turning may have twice as much."""
    smallest: float = 0.011
    """Share of a kind below which more windows with other margins are drawn."""


@dataclass(frozen=True)
class Found:
    """A single action and the clip that shows it."""

    clip: str
    """Name of the clip."""
    action: SingleAction
    """The action."""


def clip_generator(seed: int, clip: str) -> np.random.Generator:
    """Returns the random generator of a clip, which depends on its name and a seed alone."""
    number = int.from_bytes(hashlib.sha256(clip.encode()).digest()[:8], "big")
    return np.random.default_rng([seed, number])


def category_of(action: SingleAction) -> Category:
    """Returns the properties that distinguish actions in a prompt."""
    one_side = "one" if action.side in ("left", "right") else action.side
    sideways = "aside" if action.direction in ("left", "right") else action.direction
    turned = f"{45 * round(action.degrees / 45)}" if action.degrees else ""
    return (action.kind, one_side, sideways, str(action.count), turned, action.gait, action.pace)


def find_singles(
    dataset: Dataset, seed: int, clips: Iterable[Clip], kinds: frozenset[str] | None = None
) -> list[Found]:
    """Returns the single actions of clips.

    Args:
        dataset: Holds the clips; HumanML3D's features.
        seed: Seed of the margins; each clip draws for itself.
        clips: Clips to search.
        kinds: Kinds that are wanted; all by default.
    """
    singles = []
    for clip in clips:
        generator = clip_generator(seed, clip.id)
        joints = dataset.representation.decode(dataset.features(clip))
        singles += [Found(clip.id, action) for action in single_actions(joints, generator, kinds)]
    return singles


def balanced_singles(dataset: Dataset, seed: int, balance: Balance) -> list[Found]:
    """Returns single actions of the train split, drawn so that no kind dominates the others."""
    clips = [clip for clip in dataset.clips("train") if clip.source != COMPOSED]
    generator = np.random.default_rng(seed)
    by_kind: dict[str, list[Found]] = defaultdict(list)
    for single in _subsampled(find_singles(dataset, seed, clips), balance.most, generator):
        by_kind[single.action.kind].append(single)
    for draw in range(1, _DRAWS):
        fewest = balance.smallest * sum(map(len, by_kind.values()))
        rare = frozenset(kind for kind, singles in by_kind.items() if len(singles) < fewest)
        if not rare:
            break
        showing = {single.clip for kind in rare for single in by_kind[kind]}
        again = (clip for clip in clips if clip.id in showing)
        for single in find_singles(dataset, seed + 1000 * draw, again, rare):
            if single not in by_kind[single.action.kind]:
                by_kind[single.action.kind].append(single)
    total = sum(map(len, by_kind.values()))
    balanced = []
    for kind, singles in by_kind.items():
        share = balance.largest * (2 if kind in _LARGE else 1)
        balanced += singles[: int(share * total)]
    return balanced


def single_rows(
    singles: Iterable[Found], seed: int, count: int
) -> dict[str, list[tuple[str, int, int]]]:
    """Returns prompts for the windows of each clip.

    Args:
        singles: The windows.
        seed: Seed of the wording.
        count: Prompts per window.
    """
    generator = np.random.default_rng(seed)
    rows: dict[str, list[tuple[str, int, int]]] = defaultdict(list)
    for single in singles:
        action = single.action
        texts = prompts(action, generator, count)
        rows[single.clip] += [(text, action.start, action.end) for text in texts]
    return rows


def with_prompts(clip: StoredClip, rows: Mapping[str, list[tuple[str, int, int]]]) -> StoredClip:
    """Returns a clip with the prompts of its windows, and the mirrored ones."""
    existing = {row[:3] for row in clip.captions}
    return clip.with_captions(
        [row for row in dict.fromkeys(rows.get(clip.id, ())) if row not in existing]
    )


def _subsampled(singles: list[Found], most: int, generator: np.random.Generator) -> list[Found]:
    """Keeps `most` windows of each category: one of each clip, then the second, and so on."""
    categories: dict[Category, list[Found]] = defaultdict(list)
    for index in generator.permutation(len(singles)).tolist():
        categories[category_of(singles[index].action)].append(singles[index])
    sample = []
    for group in categories.values():
        count: Counter[str] = Counter()
        ranks = []
        for single in group:
            ranks.append(count[single.clip])
            count[single.clip] += 1
        order = sorted(range(len(group)), key=ranks.__getitem__)
        sample += [group[n] for n in order[:most]]
    return sample


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

    clip: Clip
    """The clip, or its mirrored copy."""
    start: int
    """Its first frame there."""
    joints: Float[np.ndarray, "frames joints 3"]
    """Positions, meters, the floor at height 0."""
    sentences: tuple[Sentence, ...]
    """Its captions, in clauses; at least one."""
    texts: tuple[str, ...]
    """The same sentences as they were written."""
    steady: bool
    """Whether any piece of it is the same action."""

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

    def cut(self, start: int, end: int) -> Cut:
        """Returns a piece of it, frames counted from its own first one."""
        return Cut(self, start, end)


@dataclass(frozen=True, eq=False)
class Cut:
    """A piece of an action clip."""

    action: ActionClip
    """The action clip."""
    start: int
    """First frame, counted from the action clip's."""
    end: int
    """One past the last frame."""

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


def _is_broken_off(
    sentences: tuple[Sentence, ...], joints: Float[np.ndarray, "frames joints 3"]
) -> bool:
    """Whether limbs are fastest where the clip ends, as in a kick that is cut at its height."""
    if any(clause.verb in _GOING for sentence in sentences for clause in sentence.clauses):
        return False
    steps = np.linalg.norm(np.diff(joints - joints[:, :1], axis=0), axis=-1).max(axis=1)
    speeds = np.convolve(steps, np.full(3, 1 / 3), "valid")
    return bool(speeds[-1] > _BROKEN_OFF * speeds.max())


def _is_steady(
    sentences: tuple[Sentence, ...],
    joints: Float[np.ndarray, "frames joints 3"],
    skeleton: Skeleton,
) -> bool:
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
