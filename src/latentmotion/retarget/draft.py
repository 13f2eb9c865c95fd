"""Drafts of joint maps: guesses from words in the names and from how the bones lie, each with why.

Words first: a limb is taken whole where joints are named for its parts, in order. Else geometry:
legs are the two branches that reach lowest, arms those that reach out farthest sideways; thigh and
shank, upper arm and forearm are the two longest bones of their branch.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from latentmotion.errors import DataError
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.retarget.humanoid import SIDES
from latentmotion.storage.files import atomic_file

_WORDS: Mapping[str, str] = {
    "hip": r"thigh|up(per)?_?leg|femur|hip",
    "knee": r"calf|shin|knee|lo(wer)?_?leg|tibia|leg",
    "ankle": r"foot|ankle",
    "foot": r"toe|ball",
    "collar": r"clavicle|collar|shoulder",
    "shoulder": r"up(per)?_?arm|humerus|shldr|shoulder|arm",
    "elbow": r"fore_?arm|lo(wer)?_?arm|elbow|radius",
    "wrist": r"hand|wrist",
}
_LIMBS = (("hip", "knee", "ankle", "foot"), ("collar", "shoulder", "elbow", "wrist"))
_SIDE_WORDS = {
    "left": r"(?i:left|links)|(^|[^a-z])[lL]([^a-z]|$)|^l(?=[A-Z])",
    "right": r"(?i:right|rechts)|(^|[^a-z])[rR]([^a-z]|$)|^r(?=[A-Z])",
}


@dataclass(frozen=True)
class Guess:
    """What a joint may be."""

    joint: int
    """Which joint of the rig."""
    reason: str
    """Why, for people to check."""


def draft_map(skeleton: Skeleton) -> dict[str, Guess]:
    """Guesses which joint of any skeleton is which of ours.

    Raises:
        DataError: There are no two branches that could be legs.
    """
    tree = _Tree(skeleton)
    guesses = {name: guess for side in SIDES for name, guess in _by_words(tree, side).items()}
    legs, arms = tree.branches()
    for limb, pair in ((_LIMBS[0], legs), (_LIMBS[1], arms)):
        for side, chain in zip(SIDES, pair, strict=True):
            needed = [f"{side}_{joint}" for joint in limb if joint not in ("foot", "collar")]
            if not all(name in guesses for name in needed):
                guesses |= _by_shape(tree, side, limb, chain)
    top = tree.head(arms)
    if top is not None:
        guesses["head"] = top
    return guesses


def write_draft(path: str | Path, skeleton: Skeleton, guesses: Mapping[str, Guess]) -> None:
    """Writes guesses as a joint map; remarks, whose names begin with `_`, say why.

    Raises:
        InputError: The folder cannot be written.
    """
    entries: dict[str, str] = {"_": "Correct what is wrong; what begins with _ is ignored."}
    for name, guess in guesses.items():
        entries[name] = skeleton.names[guess.joint]
        entries[f"_{name}"] = guess.reason
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(entries, indent=1, ensure_ascii=False), encoding="utf-8")


class _Tree:
    """A skeleton's branches, from joints to tips."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton, self.rest = skeleton, skeleton.rest_joints()
        self.lines: list[list[int]] = []
        for joint, parent in enumerate(skeleton.parents):
            self.lines.append([*(self.lines[parent] if parent >= 0 else []), joint])
        self.tips = [joint for joint in range(len(skeleton)) if not skeleton.children(joint)]
        size = np.ptp(self.rest, axis=0)
        tallest = int(np.argmax(size[1:])) + 1 if size[1:].max() > 0.8 * size[0] else 0
        self.up = np.eye(3)[tallest]
        self.heights = self.rest @ self.up

    def branches(self) -> tuple[list[list[int]], list[list[int]]]:
        """Returns legs and arms, each left and right, from where they part to their tips."""
        legs = self._pair(sorted(self.tips, key=lambda tip: self.heights[tip]), [])
        across = self.rest[legs[0][-1]] - self.rest[legs[1][-1]]
        across = across - self.up * (across @ self.up)
        across /= max(float(np.linalg.norm(across)), 1e-9)
        taken = {joint for leg in legs for joint in leg}
        out = sorted(
            self.tips, key=lambda tip: -abs(float((self.rest[tip] - self.rest[0]) @ across))
        )
        arms = self._pair([tip for tip in out if not taken & set(self.lines[tip])], [])
        left = across * self._handedness(legs, across)
        return self._sided(legs, left), self._sided(arms, left)

    def head(self, arms: list[list[int]]) -> Guess | None:
        """Returns what may be the head: named so, or the joint below the highest tip."""
        named = [
            j for j, n in enumerate(self.skeleton.names) if re.search("(?i)head(?!.*(top|end))", n)
        ]
        if named:
            return Guess(named[0], "its name says head")
        taken = {joint for arm in arms for joint in arm}
        free = [tip for tip in self.tips if not taken & set(self.lines[tip])]
        highest = max(free, key=lambda tip: self.heights[tip], default=None)
        return None if highest is None else Guess(highest, "the highest tip between the arms")

    def _pair(self, tips: list[int], none: list[int]) -> list[list[int]]:
        """Returns the first two long branches that part from each other."""
        for number, first in enumerate(tips):
            for second in tips[:number]:
                shared = len([j for j in self.lines[first] if j in self.lines[second]])
                pair = [self.lines[tip][shared:] for tip in (second, first)]
                if min(map(len, pair)) >= 3 and self._alike(*pair):
                    return pair
        raise DataError(
            f"found no pair of legs and of arms in {self.skeleton.name!r}: expected branches of at "
            "least three joints on both sides; write the map of joints by hand"
        )

    def _alike(self, a: list[int], b: list[int]) -> bool:
        lengths = [
            np.linalg.norm(np.diff(self.rest[chain], axis=0), axis=-1).sum() for chain in (a, b)
        ]
        apart = np.linalg.norm(self.rest[a[-1]] - self.rest[b[-1]])
        return bool(0.8 < lengths[0] / max(lengths[1], 1e-9) < 1.25 and apart > 0.1 * lengths[0])

    def _handedness(self, legs: list[list[int]], across: np.ndarray) -> float:
        """Returns -1 where the first leg is the right one, by the toes, which point ahead."""
        sides = [_named_side(self.skeleton.names[leg[-1]]) for leg in legs]
        if sides in (["left", "right"], ["right", "left"]):
            return 1.0 if sides[0] == "left" else -1.0
        toes = np.sum([self.rest[leg[-1]] - self.rest[leg[-2]] for leg in legs], axis=0)
        return 1.0 if np.cross(across, self.up) @ toes >= 0 else -1.0

    def _sided(self, pair: list[list[int]], left: np.ndarray) -> list[list[int]]:
        return sorted(pair, key=lambda chain: -float(self.rest[chain[-1]] @ left))


def _by_words(tree: _Tree, side: str) -> dict[str, Guess]:
    """Returns limbs whose parts are named, in order down the tree."""
    names = tree.skeleton.names
    mine = [j for j, name in enumerate(names) if _named_side(name) == side]
    found: dict[str, Guess] = {}
    for limb in _LIMBS:
        above: int | None = None
        for part in limb:
            joint = next((j for j in mine if _fits(tree, j, part, above)), None)
            if joint is not None:
                word = re.search(_WORDS[part], names[joint].lower())
                assert word is not None
                found[f"{side}_{part}"] = Guess(joint, f"its name says {side} and {word[0]}")
                above = joint
    if f"{side}_shoulder" not in found and f"{side}_collar" in found:
        found[f"{side}_shoulder"] = found.pop(f"{side}_collar")
    return found


def _fits(tree: _Tree, joint: int, part: str, above: int | None) -> bool:
    name = tree.skeleton.names[joint].lower()
    below = above is None or (above != joint and above in tree.lines[joint])
    return below and "twist" not in name and re.search(_WORDS[part], name) is not None


def _by_shape(tree: _Tree, side: str, limb: tuple[str, ...], chain: list[int]) -> dict[str, Guess]:
    """Returns the joints around the two longest bones of a branch."""
    lengths = np.linalg.norm(np.diff(tree.rest[chain], axis=0), axis=-1)
    upper, lower = sorted(np.argsort(-lengths, kind="stable")[:2].tolist())
    places = {"hip": upper, "knee": lower, "ankle": lower + 1, "foot": lower + 2}
    if limb[0] == "collar":
        places = {"collar": upper - 1, "shoulder": upper, "elbow": lower, "wrist": lower + 1}
    where = "reaches lowest" if limb[0] == "hip" else "reaches out farthest"
    return {
        f"{side}_{part}": Guess(chain[place], f"joint {place + 1} of the branch that {where}")
        for part, place in places.items()
        if 0 <= place < len(chain)
    }


def _named_side(name: str) -> str | None:
    return next((side for side, words in _SIDE_WORDS.items() if re.search(words, name)), None)
