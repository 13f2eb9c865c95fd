"""Windows of single actions in a data set, drawn so that every kind of action is as frequent.

Frequent categories are subsampled, over different clips first; kinds with few windows are shown in
several windows with other margins.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import COMPOSED, StoredClip
from latentmotion.describe.facts import SingleAction
from latentmotion.describe.prompting import prompts
from latentmotion.describe.single_actions import single_actions

Category = tuple[str, ...]
"""Kind, side, direction, count, degrees and pace of an action; left and right are one."""

_LARGE = ("walk", "turn")
"""Kinds that may have twice the share of others."""

_DRAWS = 8
"""How often windows are drawn anew for kinds that have few."""


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
    """Returns the properties that distinguish actions for a user who asks for one."""
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
    known = {row[:3] for row in clip.captions}
    return clip.with_captions(
        [row for row in dict.fromkeys(rows.get(clip.id, ())) if row not in known]
    )


def _subsampled(singles: list[Found], most: int, generator: np.random.Generator) -> list[Found]:
    """Keeps `most` windows of each category: one of each clip, then the second, and so on."""
    categories: dict[Category, list[Found]] = defaultdict(list)
    for index in generator.permutation(len(singles)).tolist():
        categories[category_of(singles[index].action)].append(singles[index])
    kept = []
    for group in categories.values():
        count: Counter[str] = Counter()
        ranks = []
        for single in group:
            ranks.append(count[single.clip])
            count[single.clip] += 1
        order = sorted(range(len(group)), key=ranks.__getitem__)
        kept += [group[n] for n in order[:most]]
    return kept
