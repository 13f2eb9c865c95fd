"""Synthetic sequences of single actions: one repeated so many times, or one and then another.

A sequence is kept if its seams are as smooth as `compose.py` asks and if measuring it anew finds
what its words tell: so many jumps, or the first action before the seam and the second after it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from latentmotion.data.captions import mirror_words
from latentmotion.data.clip import Caption
from latentmotion.data.compose import Composed, Composition, composed_source, objection
from latentmotion.data.dataset import Dataset
from latentmotion.data.manifest import COMPOSED, StoredClip
from latentmotion.data.singles import Found, find_singles
from latentmotion.data.splicing import pose_descriptors, splice
from latentmotion.data.store import StoredMotion, caption_rows
from latentmotion.describe.prompting import prompts, prompts_in_order
from latentmotion.describe.scene import scene_of
from latentmotion.describe.single import SingleAction
from latentmotion.describe.strictness import strictly
from latentmotion.errors import DataError

Joints = Float[np.ndarray, "frames joints 3"]

REPEATED = frozenset(
    ("jump", "hop", "kick", "punch", "squat", "bow", "knee", "raise", "jack", "pick_up")
)
"""Kinds of which one is shown two to four times."""

_WANTED = {
    "walk": 5.0, "run": 2.0, "jog": 2.0, "turn": 4.0, "stand": 2.0, "steps": 2.0, "kick": 3.0,
    "jump": 3.0, "punch": 2.5, "wave": 2.0, "raise": 3.0, "squat": 2.0, "pick_up": 2.0,
    "sit_down": 2.0, "stand_up": 2.0, "lie_down": 2.0, "get_up": 2.0, "bow": 1.5, "crouch": 1.5,
    "start_walking": 0.5, "speed_up": 0.5, "slow_down": 0.5, "climb": 0.3, "half_circle": 0.5,
    "weave": 0.5, "turn_then_walk": 0.5, "walk_then_turn": 0.5, "turn_and_return": 0.3,
}  # fmt: skip
"""How much more often than others a kind is drawn: what people ask for in order."""

_SIDED = ("kick", "raise", "steps", "walk", "turn", "punch", "knee", "hop")
"""Kinds that follow themselves with another side or direction."""

_PROMPTS = 4
"""Sentences about a sequence."""

_PER_KIND = 60
"""Shots of one kind that are kept, so that pairs are found in time."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A window that shows one action, ready to be joined."""

    clip: str
    """Name of the clip, with where it was cut from."""
    action: SingleAction
    """The action; its frames count from the shot's own first one."""
    joints: Joints
    """Positions in its window, meters."""
    begins: Int[np.ndarray, " some"]
    """Frames at which it may begin."""
    ends: Int[np.ndarray, " some"]
    """Frames that may be its last."""
    first: Float[np.ndarray, "some numbers"]
    """Poses where it may begin."""
    last: Float[np.ndarray, "some numbers"]
    """Poses where it may end."""


def compose_actions(
    dataset: Dataset, wanted: Composition, found: Sequence[Found] | None = None
) -> Composed:
    """Makes repeats and ordered pairs of single actions of the train split.

    Args:
        dataset: Motions in HumanML3D's features.
        wanted: How many sequences, three in eight of them repeats, and what is good enough.
        found: Single actions, where they are known.

    Raises:
        DataError: There are no single actions to join.
    """
    clips = [clip for clip in dataset.clips("train") if clip.source != COMPOSED]
    found = find_singles(dataset, wanted.seed, clips) if found is None else found
    composer = _Composer(dataset, found, wanted)
    if len(composer.by_kind) < 2:
        raise DataError(
            f"{dataset.folder}: expected at least 2 kinds of single actions in the train split, "
            f"found {len(composer.by_kind)}; add more clips"
        )
    repeats = composer.collect(composer.repeats(), wanted.count * 3 // 8, 0)
    pairs = composer.collect(composer.pairs(), wanted.count - len(repeats), len(repeats))
    return Composed((*repeats, *pairs), composed_source(dataset.sources), composer.refused)


class _Composer:
    """Draws shots, joins them and checks what came of it."""

    def __init__(self, dataset: Dataset, found: Sequence[Found], wanted: Composition) -> None:
        self.dataset, self.wanted = dataset, wanted
        self.representation = dataset.representation
        self.generator = np.random.default_rng(wanted.seed)
        self.refused: Counter[str] = Counter()
        self.used: Counter[str] = Counter()
        self.by_kind: dict[str, list[Shot]] = defaultdict(list)
        for shot in self._shots(found):
            self.by_kind[shot.action.kind].append(shot)

    def collect(
        self, sequences: Iterator[StoredMotion | None], count: int, number: int
    ) -> list[StoredMotion]:
        """Returns so many sequences, or fewer where too many are refused."""
        made: list[StoredMotion] = []
        for tried, one in enumerate(sequences):
            if one:
                name = f"{COMPOSED}-single-{self.wanted.seed}-{number + len(made):05d}"
                made.append(StoredMotion(replace(one.clip, id=name), one.features))
            if len(made) >= count or tried > 12 * count + 200:
                break
        return made

    def repeats(self) -> Iterator[StoredMotion | None]:
        """Yields single acts shown two to four times; None where a drawn one does not fit."""
        single = {
            kind: [shot for shot in self.by_kind[kind] if shot.action.count == 1]
            for kind in sorted(REPEATED & set(self.by_kind))
        }
        kinds = [kind for kind, shots in single.items() if shots]
        while kinds:
            shots = single[kinds[int(self.generator.integers(len(kinds)))]]
            shot = shots[int(self.generator.integers(len(shots)))]
            yield self._repeat(shot, int(self.generator.choice((2, 3, 4), p=(0.45, 0.35, 0.2))))

    def pairs(self) -> Iterator[StoredMotion | None]:
        """Yields two actions, drawn by kind, so that no recording decides what follows what."""
        kinds = sorted(self.by_kind)
        wanted = np.array([_WANTED.get(kind, 1.0) for kind in kinds])
        while True:
            drawn = self.generator.choice(len(kinds), size=2, p=wanted / wanted.sum())
            one, other = (kinds[int(number)] for number in drawn)
            if one != other or one in _SIDED:
                yield self._pair(one, other)

    def _repeat(self, shot: Shot, count: int) -> StoredMotion | None:
        distance = _distances(shot.last, shot.first)
        row, column = np.unravel_index(distance.argmin(), distance.shape)
        if distance[row, column] > self.wanted.distance:
            return self._refuse("no pose near enough")
        end, start = int(shot.ends[row]), int(shot.begins[column])
        joints = shot.joints[: end + 1]
        for turn in range(1, count):
            seam = len(joints) - 1
            last = shot.joints[start:] if turn == count - 1 else shot.joints[start : end + 1]
            joints = splice(joints, last, self.wanted.transition, self.representation)
            reason = objection(joints, seam, self.representation, self.wanted)
            if reason and not (reason == "too short or too long" and turn < count - 1):
                return self._refuse(reason)
        action = replace(shot.action, start=0, end=len(joints), count=count, act=(0, len(joints)))
        checked = strictly(action, scene_of(joints))
        if not checked or checked.count != count:
            return self._refuse("count is not found")
        origin = f"{count} x {shot.clip}"
        return self._stored(joints, prompts(checked, self.generator, _PROMPTS), origin)

    def _pair(self, one: str, other: str) -> StoredMotion | None:
        first = self._drawn(one)
        some = [shot for shot in (self._drawn(other) for _ in range(24)) if shot is not first]
        some = [shot for shot in some if one != other or _differs(first.action, shot.action)]
        if not some:
            return self._refuse("nothing follows")
        tables = [_distances(first.last, shot.first) for shot in some]
        best = int(np.argmin([table.min() for table in tables]))
        if tables[best].min() > self.wanted.distance:
            return self._refuse("no pose near enough")
        row, column = np.unravel_index(tables[best].argmin(), tables[best].shape)
        second, seam = some[best], int(first.ends[row])
        start = int(second.begins[column])
        joints = splice(
            first.joints[: seam + 1], second.joints[start:], self.wanted.transition,
            self.representation,
        )  # fmt: skip
        reason = objection(joints, seam, self.representation, self.wanted)
        if reason:
            return self._refuse(reason)
        told = _told(joints, seam, first.action, second.action)
        if told is None:
            return self._refuse("actions are not found")
        texts = prompts_in_order(*told, self.generator, _PROMPTS)
        return self._stored(joints, texts, f"{first.clip} + {second.clip}")

    def _drawn(self, kind: str) -> Shot:
        shots = self.by_kind[kind]
        return shots[int(self.generator.integers(len(shots)))]

    def _refuse(self, reason: str) -> None:
        self.refused[reason] += 1

    def _stored(self, joints: Joints, texts: Sequence[str], origin: str) -> StoredMotion | None:
        if not texts:
            return self._refuse("no words")
        features = self.representation.encode(joints)
        captions = [Caption(text, 0, len(features)) for text in texts]
        mirrored = [replace(caption, text=mirror_words(caption.text)) for caption in captions]
        clip = StoredClip(
            id="",
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

    def _shots(self, found: Sequence[Found]) -> Iterator[Shot]:
        """Yields some shots of every kind, and their mirror images, of different clips first."""
        clips = {clip.id: clip for clip in self.dataset.clips("train", mirrored=True)}
        taken: Counter[str] = Counter()
        of_clip: Counter[tuple[str, str]] = Counter()
        for index in self.generator.permutation(len(found)).tolist():
            one = found[index]
            kind = one.action.kind
            key = (kind, one.clip)
            if taken[kind] >= 2 * _PER_KIND or of_clip[key] >= 3 or one.action.frames > 110:
                continue
            of_clip[key] += 1
            taken[kind] += 1
            clip = clips[("M" if self.generator.random() < 0.5 else "") + one.clip]
            window = self.dataset.features(clip)[one.action.start : one.action.end]
            joints = self.representation.retarget(self.representation.decode(window))
            action = _mirrored(one.action) if clip.mirrored else one.action
            yield self._shot(f"{clip.id}[{action.start}:{action.end}]", action, joints)

    def _shot(self, name: str, action: SingleAction, joints: Joints) -> Shot:
        first, last = action.act[0] - action.start, action.act[1] - action.start
        own = replace(action, start=0, end=len(joints), act=(first, last))
        begins = np.arange(0, max(min(first, 12), 3), 2)
        end = len(joints) - 1
        ends = np.arange(min(max(last - 1, end - 12), end - 2), end + 1, 2)
        fps, skeleton = self.representation.fps, self.representation.skeleton
        poses = [pose_descriptors(joints, fps, skeleton, some) for some in (begins, ends)]
        return Shot(name, own, joints, begins, ends, *poses)


def _told(
    joints: Joints, seam: int, first: SingleAction, second: SingleAction
) -> tuple[SingleAction, SingleAction] | None:
    """Returns both actions as the sequence shows them before and after its seam."""
    if min(seam, len(joints) - seam) < 12:
        return None
    one = replace(first, start=0, end=seam + 1)
    other = replace(second, start=0, end=len(joints) - seam)
    before = strictly(one, scene_of(joints[: seam + 1]))
    after = strictly(other, scene_of(joints[seam:]))
    if before is None or after is None:
        return None
    return before, replace(after, start=seam, end=len(joints))


def _differs(one: SingleAction, other: SingleAction) -> bool:
    """Whether two actions of one kind are told differently."""
    return (one.side, one.direction) != (other.side, other.direction) and one.count == other.count


_OTHER = {"left": "right", "right": "left"}


def _mirrored(action: SingleAction) -> SingleAction:
    side, way = (_OTHER.get(word, word) for word in (action.side, action.direction))
    return replace(action, side=side, direction=way)


def _distances(
    some: Float[np.ndarray, "some numbers"], others: Float[np.ndarray, "others numbers"]
) -> Float[np.ndarray, "some others"]:
    return np.linalg.norm(some[:, None] - others[None], axis=-1)
