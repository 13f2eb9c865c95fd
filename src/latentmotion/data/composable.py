"""Which clips can be part of a longer sequence: single actions, told in one plain sentence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.manifest import COMPOSED
from latentmotion.data.sampling import Item, items_of
from latentmotion.describe.clauses import Sentence, read_clauses
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.representation.canonical import heading

_FRAMES = (12, 130)
"""Shortest and longest single action; of a steady movement a piece is taken."""

_WORDS = 14
"""Longest sentence about a part."""

_STEADY_FRAMES = 24
"""Shortest piece of a steady movement."""

_TRIMMED = (8, 0.12)
"""Most frames, and most of its length, that an action loses at either end for a better seam."""

_SHORTEST_BONE = 0.005
"""Meters; some recordings have a bone without length, which gives it no direction."""

_BROKEN_OFF = 0.9
"""Share of the greatest speed of a limb that an action has where it is cut in two."""

_GOING = {"walk", "run", "jog", "march", "sneak", "crawl", "creep", "sprint", "stroll", "stride",
          "tiptoe", "limp", "saunter", "shuffle", "skip"}  # fmt: skip
_STEADY = _GOING | {"stand", "dance", "swim", "dribble"}

_ENDING = {"turn", "turns", "turning", "circle", "circles", "semi-circle", "once", "twice",
           "times", "steps", "step", "stop", "stops", "stopping", "curve", "around", "from",
           "back", "before", "after", "until", "short", "several", "few", "distance", "up",
           "second", "seconds", "over", "onto", "off"}  # fmt: skip
"""Words that tell of something which a piece of the movement may lack."""

_TELLING = {"backward", "backwards", "sideways", "left", "right", "circle", "slowly", "quickly",
            "fast", "place", "up", "down", "both", "floor"}  # fmt: skip
"""Words that make one walk another action than the next."""

_REFUSED = {"again", "continue", "continues", "same", "repeat", "repeats", "video", "resume"}
"""Words that refer to what was before."""


@dataclass(frozen=True, eq=False)
class Part:
    """A clip, or a captioned part of one, that tells of a single action."""

    clip: Clip
    """The clip, or its mirrored copy."""
    start: int
    """Its first frame there."""
    joints: Float[np.ndarray, "frames joints 3"]
    """Positions, meters, the floor at height 0."""
    sentences: tuple[Sentence, ...]
    """What is said about it, in clauses; at least one."""
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
        """Verbs and telling words of its first sentence."""
        clauses = self.sentences[0].clauses
        words = {word for clause in clauses for word in (*clause.rest, *clause.before)}
        return frozenset({clause.verb for clause in clauses} | (words & _TELLING))

    @property
    def slack(self) -> int:
        """Frames that it may lose at either end."""
        return min(_TRIMMED[0], int(_TRIMMED[1] * len(self.joints)))

    @property
    def least(self) -> int:
        """Fewest frames that it may be cut to."""
        return min(_STEADY_FRAMES, len(self.joints) - 1) if self.steady else len(self.joints)

    def cut(self, start: int, end: int) -> Cut:
        """Returns a piece of it, frames counted from its own first one."""
        return Cut(self, start, end)


@dataclass(frozen=True, eq=False)
class Cut:
    """A piece of a part."""

    part: Part
    """The part."""
    start: int
    """First frame, counted from the part's."""
    end: int
    """One past the last frame."""

    @property
    def origin(self) -> str:
        """Clip, frames at the data set's rate, and the recording that the clip was cut from."""
        clip, shift = self.part.clip, self.part.start
        return f"{clip.id}[{self.start + shift}:{self.end + shift}] ({clip.source} {clip.origin})"


def parts_of_dataset(dataset: Dataset) -> list[Part]:
    """Returns the single actions of the train split and their mirror images."""
    clips = [
        c for c in dataset.clips("train", mirrored=True) if c.captions and c.source != COMPOSED
    ]
    found = (_part(dataset, item) for item in items_of(clips))
    return [part for part in found if part is not None]


def interest(first: Part, second: Part) -> float:
    """Returns how often a pair is wanted: "walk, then …" and "…, then walk" are what users ask."""
    ways = [bool(part.verbs & (_GOING | {"stand"})) for part in (first, second)]
    return 4.0 if sum(ways) == 1 else 1.0


def _part(dataset: Dataset, item: Item) -> Part | None:
    read = [(sentence, text) for text in item.captions if (sentence := _single(text))]
    if not read or 3 * len(read) < len(item.captions) or item.frames < _FRAMES[0]:
        return None
    joints = dataset.representation.decode(dataset.features(item.clip)[item.start : item.end])
    parents = [max(parent, 0) for parent in dataset.representation.skeleton.parents]
    if np.linalg.norm(joints - joints[:, parents], axis=-1)[:, 1:].min() < _SHORTEST_BONE:
        return None
    joints = dataset.representation.retarget(joints)  # a mirrored copy has the other side's bones
    sentences, texts = zip(*read, strict=True)
    steady = _is_steady(sentences, joints, dataset.representation.skeleton)
    if not steady and (item.frames > _FRAMES[1] or _is_broken_off(sentences, joints)):
        return None
    return Part(item.clip, item.start, joints, sentences, texts, steady)


def _single(text: str) -> Sentence | None:
    """Reads a sentence about a single action; None where it tells of more, or of less."""
    sentence = read_clauses(text)
    if sentence is None or sentence.referring or len(sentence.clauses) > 2:
        return None
    words = text.lower().replace(".", "").split()
    ordered = any(clause.link in ("then", ".", ",") for clause in sentence.clauses)
    plain = len(words) <= _WORDS and not _REFUSED & set(words[:-1]) and "," not in text
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
    """Whether a movement goes on alike: by its words, and on its way by speed and heading."""
    verbs = {clause.verb for sentence in sentences for clause in sentence.clauses}
    words = {word for sentence in sentences for c in sentence.clauses for word in c.rest}
    if not verbs <= _STEADY or words & _ENDING or len(joints) < 2 * _STEADY_FRAMES:
        return False
    if not verbs & _GOING:
        return True
    thirds = np.array_split(joints, 3)
    ways = np.array([np.linalg.norm((t[-1, 0] - t[0, 0])[::2]) / len(t) for t in thirds])
    facing = np.unwrap(np.asarray(heading(joints, skeleton)))
    return bool(ways.min() > 0.6 * ways.mean() and np.ptp(facing) < np.radians(60))
