"""Windows of single actions in a data set, drawn so that every kind of action is told as often.

Frequent categories are drawn down, over different clips first; kinds with few windows are shown in
several windows with other margins.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from latentmotion.data.captions import mirror_words
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.manifest import COMPOSED, CaptionRow, StoredClip
from latentmotion.describe.prompting import prompts
from latentmotion.describe.single import SingleAction
from latentmotion.describe.single_actions import single_actions

Category = tuple[str, ...]
"""Kind, side, direction, count, degrees and pace of an action; left and right are one."""

_LARGE = ("walk", "turn")
"""Kinds that may have twice the share of others."""

_DRAWS = 8
"""How often windows are drawn anew for kinds that have few."""


@dataclass(frozen=True)
class Balance:
    """How many windows there are of what."""

    most: int = 40
    """Windows of one category."""
    largest: float = 0.055
    """Largest share of one kind; walking and turning may have twice as much."""
    smallest: float = 0.011
    """Smallest share of a kind that can be had by other margins."""


@dataclass(frozen=True)
class Found:
    """A single action and the clip that shows it."""

    clip: str
    """Name of the clip."""
    action: SingleAction
    """The action."""


def category_of(action: SingleAction) -> Category:
    """Returns what makes an action another one than the next for whoever asks for it."""
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
        seed: What draws margins; each clip draws for itself.
        clips: Which are searched.
        kinds: Kinds that are wanted; all by default.
    """
    found = []
    for clip in clips:
        generator = np.random.default_rng([seed, _number(clip.id)])
        joints = dataset.representation.decode(dataset.features(clip))
        found += [Found(clip.id, action) for action in single_actions(joints, generator, kinds)]
    return found


def balanced_singles(dataset: Dataset, seed: int, balance: Balance) -> list[Found]:
    """Returns single actions of the train split, drawn so that no kind drowns the others."""
    clips = [clip for clip in dataset.clips("train") if clip.source != COMPOSED]
    generator = np.random.default_rng(seed)
    found = _drawn_down(find_singles(dataset, seed, clips), balance.most, generator)
    by_kind = _by_kind(found)
    for draw in range(1, _DRAWS):
        rare = _rare(by_kind, balance)
        if not rare:
            break
        showing = {one.clip for kind in rare for one in by_kind[kind]}
        again = (clip for clip in clips if clip.id in showing)
        for one in find_singles(dataset, seed + 1000 * draw, again, rare):
            if one not in by_kind[one.action.kind]:
                by_kind[one.action.kind].append(one)
    return [one for kind in by_kind.values() for one in kind[: _cap(by_kind, kind, balance)]]


def single_rows(
    found: Iterable[Found], seed: int, count: int
) -> dict[str, list[tuple[str, int, int]]]:
    """Returns prompts for the windows of each clip.

    Args:
        found: The windows.
        seed: What draws the wording.
        count: Prompts per window.
    """
    generator = np.random.default_rng(seed)
    rows: dict[str, list[tuple[str, int, int]]] = defaultdict(list)
    for one in found:
        action = one.action
        texts = prompts(action, generator, count)
        rows[one.clip] += [(text, action.start, action.end) for text in texts]
    return rows


def with_prompts(clip: StoredClip, rows: Mapping[str, list[tuple[str, int, int]]]) -> StoredClip:
    """Returns a clip with the prompts of its windows, and the mirrored ones."""
    known = {row[:3] for row in clip.captions}
    new = [row for row in dict.fromkeys(rows.get(clip.id, ())) if row not in known]
    added: tuple[CaptionRow, ...] = tuple((*row, "") for row in new)
    mirrored = tuple((mirror_words(text), start, end, "") for text, start, end in new)
    return replace(
        clip,
        captions=(*clip.captions, *added),
        mirrored_captions=(*clip.mirrored_captions, *mirrored),
    )


def _drawn_down(found: list[Found], most: int, generator: np.random.Generator) -> list[Found]:
    """Keeps so many windows of each category: one of each clip, then the second, and so on."""
    categories: dict[Category, list[Found]] = defaultdict(list)
    for index in generator.permutation(len(found)).tolist():
        categories[category_of(found[index].action)].append(found[index])
    kept = []
    for group in categories.values():
        seen: Counter[str] = Counter()
        turns = []
        for one in group:
            turns.append(seen[one.clip])
            seen[one.clip] += 1
        order = sorted(range(len(group)), key=lambda n: turns[n])
        kept += [group[n] for n in order[:most]]
    return kept


def _by_kind(found: list[Found]) -> dict[str, list[Found]]:
    by_kind: dict[str, list[Found]] = defaultdict(list)
    for one in found:
        by_kind[one.action.kind].append(one)
    return by_kind


def _rare(by_kind: dict[str, list[Found]], balance: Balance) -> frozenset[str]:
    total = sum(map(len, by_kind.values()))
    return frozenset(k for k, of in by_kind.items() if len(of) < balance.smallest * total)


def _cap(by_kind: dict[str, list[Found]], kind: list[Found], balance: Balance) -> int:
    total = sum(map(len, by_kind.values()))
    share = balance.largest * (2 if kind[0].action.kind in _LARGE else 1)
    return int(share * total)


def _number(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
