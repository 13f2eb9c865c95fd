"""Synthetic sequences of single actions: one repeated several times, or one and then another.

A sequence is kept if its seams are as smooth as `compose.py` requires and if measuring it anew
finds what its captions say: the number of jumps, or the first action before the seam and the second
after it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import COMPOSED, StoredMotion
from latentmotion.errors import DataError
from latentmotion.language.claims import kinds
from latentmotion.measure.facts import BOTH, SingleAction
from latentmotion.measure.scene import describe
from latentmotion.representation.splicing import pose_descriptors, splice
from latentmotion.training.captioning import compose
from latentmotion.training.captioning.prompting import prompts, prompts_in_order
from latentmotion.training.captioning.singles import Found, find_singles
from latentmotion.training.captioning.strictness import strictly

Joints = Float[np.ndarray, "frames joints 3"]

REPEATED = frozenset(kinds("composed"))
"""Kinds that are repeated two to four times."""

# Weights of kinds, as users ask for them in sequences; others have 1.
_KIND_WEIGHTS = {
    "walk": 8.0, "run": 3.0, "jog": 3.0, "turn": 4.0, "stand": 2.0, "steps": 2.0, "kick": 3.0,
    "jump": 3.0, "punch": 2.5, "wave": 2.0, "raise": 3.0, "squat": 2.0, "pick_up": 2.0,
    "sit_down": 2.0, "stand_up": 2.0, "lie_down": 2.0, "get_up": 2.0, "bow": 1.5, "crouch": 1.5,
    "start_walking": 3.0, "stop_walking": 3.0, "start_running": 1.5, "stop_running": 1.5,
    "speed_up": 0.5, "slow_down": 0.5, "climb": 0.3, "half_circle": 0.5,
    "weave": 0.5, "turn_then_walk": 0.5, "walk_then_turn": 0.5, "turn_and_return": 0.3,
}  # fmt: skip

# Kinds that follow themselves with another side or direction.
_SIDED = ("kick", "raise", "steps", "walk", "turn", "punch", "knee", "hop")

_GAITS = kinds("gait")
_STOPS = {"stop_walking": "walk", "stop_running": "run"}
_STARTS = {"start_walking": "walk", "start_running": "run"}

# Largest distance of poses with their speeds where one gait becomes another, meters.
_CHANGE = 0.45

# Sequences of the same kinds that fail in a row before no more are tried.
_MOST_FAILURES = 40

# Sentences about a sequence.
_PROMPTS = 4

# Shots of one kind that are kept, so that pairs are found in time.
_PER_KIND = 60


_OTHER_SIDE = {"left": "right", "right": "left"}


@dataclass(frozen=True, eq=False)
class Shot:
    """A window that shows one action, ready to be joined."""

    clip: str
    """Name of the clip, with where it was cut from."""
    action: SingleAction
    """The action; its frames count from the shot's own first one."""
    joints: Joints
    """Positions in its window, meters."""
    begins: Int[np.ndarray, " begins"]
    """Frames at which it may begin."""
    ends: Int[np.ndarray, " ends"]
    """Frames that may be its last."""
    first: Float[np.ndarray, "begins numbers"]
    """Poses where it may begin."""
    last: Float[np.ndarray, "ends numbers"]
    """Poses where it may end."""

    def nearest(self, following: Shot) -> tuple[float, int, int]:
        """Returns the best seam to another shot.

        Returns:
            The distance of the poses, meters, the last frame of this one, the first of the other.
        """
        table = np.linalg.norm(self.last[:, None] - following.first[None], axis=-1)
        row, column = np.unravel_index(table.argmin(), table.shape)
        return float(table[row, column]), int(self.ends[row]), int(following.begins[column])


def compose_actions(
    dataset: Dataset, composition: compose.Composition, singles: Sequence[Found] | None = None
) -> compose.Composed:
    """Makes repeats and ordered pairs of single actions of the train split.

    Args:
        dataset: Motions in HumanML3D's features.
        composition: Number of sequences, three in eight of them repeats, and their quality.
        singles: Single actions, where they are known.

    Raises:
        DataError: There are no single actions to join.
    """
    clips = [clip for clip in dataset.clips("train") if clip.source != COMPOSED]
    singles = find_singles(dataset, composition.seed, clips) if singles is None else singles
    composer = _ActionComposer(dataset, singles, composition)
    if len(composer.by_kind) < 2:
        raise DataError(
            f"{dataset.folder}: expected at least 2 kinds of single actions in the train split, "
            f"found {len(composer.by_kind)}; add more clips"
        )
    repeats = composer.repeats(composition.count * 3 // 8)
    sequences = [*repeats, *composer.pairs(composition.count - len(repeats))]
    motions = tuple(
        replace(
            sequence,
            clip=replace(sequence.clip, id=f"{COMPOSED}-single-{composition.seed}-{number:05d}"),
        )
        for number, sequence in enumerate(sequences)
    )
    return compose.Composed(motions, compose.composed_source(dataset.sources), composer.refused)


class _ActionComposer:
    """Draws shots, joins them and checks the result."""

    def __init__(
        self, dataset: Dataset, singles: Sequence[Found], composition: compose.Composition
    ) -> None:
        self.wanted, self.representation = composition, dataset.representation
        self.generator = np.random.default_rng(composition.seed)
        self.refused: Counter[str] = Counter()
        self.by_kind: dict[str, list[Shot]] = defaultdict(list)
        # Some shots of every kind, and their mirror images, of different clips first.
        clips = {clip.id: clip for clip in dataset.clips("train", mirrored=True)}
        count_by_kind: Counter[str] = Counter()
        count_by_clip: Counter[tuple[str, str]] = Counter()
        for index in self.generator.permutation(len(singles)).tolist():
            action = singles[index].action
            key = (action.kind, singles[index].clip)
            enough = count_by_kind[action.kind] >= 2 * _PER_KIND or count_by_clip[key] >= 3
            if enough or action.frames > 110:
                continue
            count_by_kind[action.kind] += 1
            count_by_clip[key] += 1
            clip = clips[("M" if self.generator.random() < 0.5 else "") + singles[index].clip]
            window = dataset.features(clip)[action.start : action.end]
            joints = self.representation.retarget(self.representation.decode(window))
            action = _mirrored(action) if clip.mirrored else action
            shot = self._shot(f"{clip.id}[{action.start}:{action.end}]", action, joints)
            self.by_kind[action.kind].append(shot)

    def repeats(self, count: int) -> list[StoredMotion]:
        """Returns single acts repeated two to four times, and marching, equally of all kinds."""
        act_counts: list[tuple[str, int]] = [
            (kind, times) for kind in sorted(REPEATED & set(self.by_kind)) for times in (2, 3, 4)
        ]
        if "knee" in self.by_kind:
            act_counts += [("march", times) for times in (3, 4, 5, 6)]
        quotas = dict.fromkeys(act_counts, 1.2 * count / max(len(act_counts), 1))
        return self._filled(quotas, count, lambda key: self._repeated(*key))

    def pairs(self, count: int) -> list[StoredMotion]:
        """Returns two actions in order, drawn by kind, so that no recording decides the order."""
        kinds = sorted(self.by_kind)
        weights = {
            (first, second): _KIND_WEIGHTS.get(first, 1.0) * _KIND_WEIGHTS.get(second, 1.0)
            for first in kinds
            for second in kinds
            if first != second or first in _SIDED
        }
        scale = count / sum(weights.values())
        rounded = {
            key: int(1.4 * scale * weight + self.generator.random())
            for key, weight in weights.items()
        }
        quotas = {key: number for key, number in rounded.items() if number}
        return self._filled(quotas, count, lambda key: self._pair(*key))

    def _filled(
        self,
        quotas: Mapping[Any, float],
        count: int,
        make: Callable[[Any], StoredMotion | None],
    ) -> list[StoredMotion]:
        """Makes sequences in rounds until each key has its quota or has failed too often."""
        sequences: list[StoredMotion] = []
        successes: Counter[tuple[Any, ...]] = Counter()
        failures: Counter[tuple[Any, ...]] = Counter()
        keys = list(quotas)
        while keys and len(sequences) < count:
            for index in self.generator.permutation(len(keys)).tolist():
                key = keys[index]
                motion = make(key)
                failures[key] = 0 if motion else failures[key] + 1
                successes[key] += motion is not None
                sequences += [motion] if motion else []
            keys = [
                key
                for key in keys
                if successes[key] < quotas[key] and failures[key] < _MOST_FAILURES
            ]
        order = self.generator.permutation(len(sequences))[:count]
        return [sequences[index] for index in order.tolist()]

    def _repeated(self, kind: str, times: int) -> StoredMotion | None:
        """Repeats one shot, or marches with a knee's shot and its mirror image in turn."""
        shots = [
            shot
            for shot in self.by_kind["knee" if kind == "march" else kind]
            if shot.action.kind == "raise" or (shot.action.count == 1 and shot.action.side != BOTH)
        ]
        if not shots:
            return self._refuse("nothing to repeat")
        shot = shots[int(self.generator.integers(len(shots)))]
        cycle = [shot, self._mirror(shot)] if kind == "march" else [shot]
        joints = self._cycled(cycle, times)
        if isinstance(joints, str):
            return self._refuse(joints)
        whole = (0, len(joints))
        side = BOTH if kind == "march" else shot.action.side
        action = replace(shot.action, start=0, end=len(joints), count=times, side=side, act=whole)
        checked = strictly(action, describe(joints))
        if not checked or checked.count != times:
            return self._refuse("count is not found")
        if kind == "march" and times >= 4:
            checked = SingleAction("march", *whole, act=whole)
        texts = prompts(checked, self.generator, _PROMPTS, self.wanted.refused_captions)
        return self._stored(joints, texts, f"{times} x {shot.clip}")

    def _cycled(self, shots: list[Shot], times: int) -> Joints | str:
        """Joins so many shots in turn; returns why if that is not smooth."""
        joints = shots[0].joints
        start = 0
        for turn in range(times):
            shot, following = shots[turn % len(shots)], shots[(turn + 1) % len(shots)]
            distance, last, next_start = shot.nearest(following)
            if distance > self.wanted.distance:
                return "no pose near enough"
            end = last + 1 if turn < times - 1 else len(shot.joints)
            piece, start = shot.joints[start:end], next_start
            if turn == 0:
                joints = piece
                continue
            seam = len(joints) - 1
            joints = splice(joints, piece, self.wanted.transition, self.representation)
            reason = compose.objection(joints, seam, self.representation, self.wanted)
            if reason and (reason != "too short or too long" or turn == times - 1):
                return reason
        return joints

    def _pair(self, first_kind: str, second_kind: str) -> StoredMotion | None:
        """Joins two actions, of several drawn those whose poses are nearest."""
        best: tuple[float, Shot, Shot] | None = None
        for first in [self._draw_shot(first_kind) for _ in range(4)]:
            candidates = [self._draw_shot(second_kind) for _ in range(16)]
            if first_kind == second_kind:  # only those that captions distinguish
                action = first.action
                candidates = [
                    shot
                    for shot in (self._mirror(first), *candidates)
                    if action.count == shot.action.count
                    and (action.side, action.direction) != (shot.action.side, shot.action.direction)
                ]
            for shot in candidates:
                near = first.nearest(shot)[0]
                if shot.clip != first.clip and (best is None or near < best[0]):
                    best = near, first, shot
        gaits = first_kind in _GAITS and second_kind in _GAITS
        if best is None or best[0] > (_CHANGE if gaits else self.wanted.distance):
            return self._refuse("no pose near enough")
        return self._joined(best[1], best[2])

    def _joined(self, first: Shot, second: Shot) -> StoredMotion | None:
        _, seam, start = first.nearest(second)
        joints = splice(
            first.joints[: seam + 1],
            second.joints[start:],
            self.wanted.transition,
            self.representation,
        )
        reason = compose.objection(joints, seam, self.representation, self.wanted)
        if reason:
            return self._refuse(reason)
        before = after = None
        rest = len(joints) - seam
        if min(seam, rest) >= 12:
            action = replace(first.action, start=0, end=seam + 1)
            before = strictly(action, describe(joints[: seam + 1]))
            action = replace(second.action, start=0, end=rest)
            after = strictly(action, describe(joints[seam:]))
        if before is None or after is None:
            return self._refuse("actions are not found")
        after = replace(after, start=seam, end=len(joints))
        # A stop before something, and a start after it, are often described as walking or running.
        stopped, started = _STOPS.get(before.kind), _STARTS.get(after.kind)
        if stopped and after.kind != "stand" and self.generator.random() < 0.75:
            before = replace(before, kind=stopped)
        same = (before.kind, before.direction) == (started, after.direction)
        if started and before.kind != "stand" and not same and self.generator.random() < 0.75:
            after = replace(after, kind=started)
        refused = self.wanted.refused_captions
        texts = prompts_in_order(before, after, self.generator, _PROMPTS, refused)
        return self._stored(joints, texts, f"{first.clip} + {second.clip}")

    def _mirror(self, shot: Shot) -> Shot:
        joints = shot.joints[:, list(self.representation.skeleton.mirror)] * np.array([-1, 1, 1])
        joints = self.representation.retarget(joints)
        return self._shot(f"M{shot.clip}".removeprefix("MM"), _mirrored(shot.action), joints)

    def _draw_shot(self, kind: str) -> Shot:
        shots = self.by_kind[kind]
        return shots[int(self.generator.integers(len(shots)))]

    def _refuse(self, reason: str) -> None:
        self.refused[reason] += 1

    def _stored(self, joints: Joints, texts: Sequence[str], origin: str) -> StoredMotion | None:
        if not texts:
            return self._refuse("no words")
        features = self.representation.encode(joints)
        captions = [Caption(text, 0, len(features)) for text in texts]
        return compose.composed_motion("", features, captions, origin)

    def _shot(self, name: str, action: SingleAction, joints: Joints) -> Shot:
        first, last = action.act[0] - action.start, action.act[1] - action.start
        shifted = replace(action, start=0, end=len(joints), act=(first, last))
        end = len(joints) - 1
        begins = np.arange(0, max(min(first, 12), 3), 2)
        ends = np.arange(min(max(last - 1, end - 12), end - 2), end + 1, 2)
        if action.kind in (*_GAITS, "stand", "sit", "lie"):
            begins = np.arange(0, max(end - 24, 3), 2)
            ends = np.arange(min(22, end - 2), end + 1, 2)
        fps, skeleton = self.representation.fps, self.representation.skeleton
        poses = [pose_descriptors(joints, fps, skeleton, frames) for frames in (begins, ends)]
        return Shot(name, shifted, joints, begins, ends, *poses)


def _mirrored(action: SingleAction) -> SingleAction:
    side, direction = (_OTHER_SIDE.get(word, word) for word in (action.side, action.direction))
    return replace(action, side=side, direction=direction)
