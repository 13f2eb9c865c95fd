"""Synthetic sequences of single actions: one repeated so many times, or one and then another.

A sequence is kept if its seams are as smooth as `compose.py` asks and if measuring it anew finds
what its words tell: so many jumps, or the first action before the seam and the second after it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

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
from latentmotion.describe.facts import BOTH
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
    "walk": 8.0, "run": 3.0, "jog": 3.0, "turn": 4.0, "stand": 2.0, "steps": 2.0, "kick": 3.0,
    "jump": 3.0, "punch": 2.5, "wave": 2.0, "raise": 3.0, "squat": 2.0, "pick_up": 2.0,
    "sit_down": 2.0, "stand_up": 2.0, "lie_down": 2.0, "get_up": 2.0, "bow": 1.5, "crouch": 1.5,
    "start_walking": 3.0, "stop_walking": 3.0, "start_running": 1.5, "stop_running": 1.5,
    "speed_up": 0.5, "slow_down": 0.5, "climb": 0.3, "half_circle": 0.5,
    "weave": 0.5, "turn_then_walk": 0.5, "walk_then_turn": 0.5, "turn_and_return": 0.3,
}  # fmt: skip
"""How much more often than others a kind is drawn: what people ask for in order."""

_SIDED = ("kick", "raise", "steps", "walk", "turn", "punch", "knee", "hop")
"""Kinds that follow themselves with another side or direction."""

_GAITS = ("walk", "jog", "run")
_STOPS = {"stop_walking": "walk", "stop_running": "run"}
_STARTS = {"start_walking": "walk", "start_running": "run"}

_CHANGE = 0.45
"""Largest distance of poses with their speeds where one gait becomes another, meters."""

_PATIENCE = 40
"""Sequences of the same kinds that fail in a row before no more are tried."""

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
    repeats = composer.repeats(wanted.count * 3 // 8)
    made = [*repeats, *composer.pairs(wanted.count - len(repeats))]
    motions = tuple(
        replace(one, clip=replace(one.clip, id=f"{COMPOSED}-single-{wanted.seed}-{number:05d}"))
        for number, one in enumerate(made)
    )
    return Composed(motions, composed_source(dataset.sources), composer.refused)


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

    def repeats(self, count: int) -> list[StoredMotion]:
        """Returns single acts shown two to four times, and knees that march, of all kinds alike."""
        wanted: list[tuple[str, int]] = [
            (kind, times) for kind in sorted(REPEATED & set(self.by_kind)) for times in (2, 3, 4)
        ]
        if "knee" in self.by_kind:
            wanted += [("march", times) for times in (3, 4, 5, 6)]
        quotas = dict.fromkeys(wanted, 1.2 * count / max(len(wanted), 1))
        return self._filled(quotas, count, lambda key: self._repeated(*key))

    def pairs(self, count: int) -> list[StoredMotion]:
        """Returns two actions in order, drawn by kind: no recording decides what follows what."""
        kinds = sorted(self.by_kind)
        weights = {
            (one, other): _WANTED.get(one, 1.0) * _WANTED.get(other, 1.0)
            for one in kinds
            for other in kinds
            if one != other or one in _SIDED
        }
        scale = count / sum(weights.values())
        whole = {
            key: int(1.4 * scale * weight + self.generator.random())
            for key, weight in weights.items()
        }
        quotas = {key: number for key, number in whole.items() if number}
        return self._filled(quotas, count, lambda key: self._pair(*key))

    def _filled(
        self,
        quotas: Mapping[Any, float],
        count: int,
        make: Callable[[Any], StoredMotion | None],
    ) -> list[StoredMotion]:
        """Makes as many sequences of each key as it may have, in rounds; what fails often ends."""
        made: list[StoredMotion] = []
        have: Counter[tuple[Any, ...]] = Counter()
        vain: Counter[tuple[Any, ...]] = Counter()
        keys = list(quotas)
        while keys and len(made) < count:
            for index in self.generator.permutation(len(keys)).tolist():
                key = keys[index]
                motion = make(key)
                vain[key] = 0 if motion else vain[key] + 1
                have[key] += motion is not None
                made += [motion] if motion else []
            keys = [key for key in keys if have[key] < quotas[key] and vain[key] < _PATIENCE]
        order = self.generator.permutation(len(made))[:count]
        return [made[index] for index in order.tolist()]

    def _repeated(self, kind: str, times: int) -> StoredMotion | None:
        shots = [s for s in self.by_kind["knee" if kind == "march" else kind] if _is_once(s)]
        if not shots:
            return self._refuse("nothing to repeat")
        shot = shots[int(self.generator.integers(len(shots)))]
        if kind == "march":
            return self._repeat([shot, self._mirror(shot)], times, marching=times >= 4)
        return self._repeat([shot], times)

    def _repeat(self, shots: list[Shot], times: int, marching: bool = False) -> StoredMotion | None:
        """Joins one shot, or two in turn, so many times; None where it is not smooth or exact."""
        joints = shots[0].joints
        start = 0
        for turn in range(times):
            shot, following = shots[turn % len(shots)], shots[(turn + 1) % len(shots)]
            distance = _distances(shot.last, following.first)
            row, column = np.unravel_index(distance.argmin(), distance.shape)
            if distance[row, column] > self.wanted.distance:
                return self._refuse("no pose near enough")
            end = int(shot.ends[row]) + 1 if turn < times - 1 else len(shot.joints)
            part, start = shot.joints[start:end], int(following.begins[column])
            if turn == 0:
                joints = part
                continue
            seam = len(joints) - 1
            joints = splice(joints, part, self.wanted.transition, self.representation)
            reason = objection(joints, seam, self.representation, self.wanted)
            if reason and (reason != "too short or too long" or turn == times - 1):
                return self._refuse(reason)
        side = shots[0].action.side if len(shots) == 1 else BOTH
        whole = (0, len(joints))
        action = replace(
            shots[0].action, start=0, end=len(joints), count=times, side=side, act=whole
        )
        checked = strictly(action, scene_of(joints))
        if not checked or checked.count != times:
            return self._refuse("count is not found")
        told = SingleAction("march", *whole, act=whole) if marching else checked
        texts = prompts(told, self.generator, _PROMPTS, self.wanted.refused_captions)
        return self._stored(joints, texts, f"{times} x {shots[0].clip}")

    def _pair(self, one: str, other: str) -> StoredMotion | None:
        best: tuple[float, Shot, Shot] | None = None
        for first in [self._drawn(one) for _ in range(4)]:
            some = [self._drawn(other) for _ in range(16)]
            if one == other:
                some = [self._mirror(first), *some]
                some = [shot for shot in some if _differs(first.action, shot.action)]
            for shot in some:
                near = float(_distances(first.last, shot.first).min())
                if shot.clip != first.clip and (best is None or near < best[0]):
                    best = near, first, shot
        ways = one in _GAITS and other in _GAITS
        if best is None or best[0] > (_CHANGE if ways else self.wanted.distance):
            return self._refuse("no pose near enough")
        return self._joined(best[1], best[2])

    def _joined(self, first: Shot, second: Shot) -> StoredMotion | None:
        table = _distances(first.last, second.first)
        row, column = np.unravel_index(table.argmin(), table.shape)
        seam, start = int(first.ends[row]), int(second.begins[column])
        one, other = first.joints[: seam + 1], second.joints[start:]
        joints = splice(one, other, self.wanted.transition, self.representation)
        reason = objection(joints, seam, self.representation, self.wanted)
        if reason:
            return self._refuse(reason)
        told = _told(joints, seam, first.action, second.action)
        if told is None:
            return self._refuse("actions are not found")
        asked, refused = self._as_asked(*told), self.wanted.refused_captions
        texts = prompts_in_order(*asked, self.generator, _PROMPTS, refused)
        return self._stored(joints, texts, f"{first.clip} + {second.clip}")

    def _as_asked(
        self, first: SingleAction, second: SingleAction
    ) -> tuple[SingleAction, SingleAction]:
        """Tells of a stop before something, and of a start after it, as of walking or running."""
        before, after = _STOPS.get(first.kind), _STARTS.get(second.kind)
        if before and second.kind != "stand" and self.generator.random() < 0.75:
            first = replace(first, kind=before)
        same = (first.kind, first.direction) == (after, second.direction)
        if after and first.kind != "stand" and not same and self.generator.random() < 0.75:
            second = replace(second, kind=after)
        return first, second

    def _mirror(self, shot: Shot) -> Shot:
        joints = shot.joints[:, list(self.representation.skeleton.mirror)] * np.array([-1, 1, 1])
        joints = self.representation.retarget(joints)
        return self._shot(f"M{shot.clip}".removeprefix("MM"), _mirrored(shot.action), joints)

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
        end = len(joints) - 1
        begins = np.arange(0, max(min(first, 12), 3), 2)
        ends = np.arange(min(max(last - 1, end - 12), end - 2), end + 1, 2)
        if action.kind in (*_GAITS, "stand", "sit", "lie"):
            begins = np.arange(0, max(end - 24, 3), 2)
            ends = np.arange(min(22, end - 2), end + 1, 2)
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


def _is_once(shot: Shot) -> bool:
    return (shot.action.count == 1 and shot.action.side != BOTH) or shot.action.kind == "raise"


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
