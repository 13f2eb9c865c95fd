"""Drafts of joint maps for skeletons with unknown names: guesses, with reasons.

Known names first, then words: a limb is complete where joints are named for its parts, in order.
Else geometry: legs are the two branches that reach lowest, arms those that reach out farthest
sideways; thigh and shank, upper arm and forearm are the two longest bones of their branch.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from latentmotion.errors import DataError
from latentmotion.kinematics.bone_names import REQUIRED, SIDES, match_names
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.storage.files import atomic_file, check_writable

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


# Words for heads, and for the tips of bones, which are no joints.
_HEAD, _TIP = "(head|kopf|頭)", "top|end|先"


@dataclass(frozen=True)
class Guess:
    """A guess for one of our joints."""

    joint: int  # The rig's joint.
    reason: str  # The reason, for people to check.


def draft_map(skeleton: Skeleton) -> dict[str, Guess]:
    """Guesses which joint of any skeleton is which of ours.

    Raises:
        DataError: Names say too little, and there are no two branches that could be legs.
    """
    tree, match = _Tree(skeleton), match_names(skeleton.names)
    guesses = {name: guess for side in SIDES for name, guess in _by_words(tree, side).items()}
    if len(match.missing) <= len(REQUIRED) // 2:
        reason = f"its name, as in {match.convention}"
        guesses |= {name: Guess(joint, reason) for name, joint in match.joints.items()}
    if all(name in guesses for name in (*REQUIRED, "head")):
        return guesses
    legs, arms = tree.branches()
    for limb, pair in ((_LIMBS[0], legs), (_LIMBS[1], arms)):
        for side, branch in zip(SIDES, pair, strict=True):
            needed = [f"{side}_{joint}" for joint in limb if joint not in ("foot", "collar")]
            if all(name in guesses for name in needed):
                continue
            # The joints around the two longest bones of the branch.
            lengths = np.linalg.norm(np.diff(tree.rest[branch], axis=0), axis=-1)
            upper, lower = sorted(np.argsort(-lengths, kind="stable")[:2].tolist())
            if limb[0] == "hip":
                indices = {"hip": upper, "knee": lower, "ankle": lower + 1, "foot": lower + 2}
                which = "reaches lowest"
            else:
                indices = {"collar": upper - 1, "shoulder": upper, "elbow": lower}
                indices["wrist"], which = lower + 1, "reaches out farthest"
            for joint, index in indices.items():
                if 0 <= index < len(branch):
                    reason = f"joint {index + 1} of the branch that {which}"
                    guesses[f"{side}_{joint}"] = Guess(branch[index], reason)
    head = tree.head(arms)
    if head is not None:
        guesses.setdefault("head", head)
    return guesses


def write_draft(path: str | Path, skeleton: Skeleton, guesses: Mapping[str, Guess]) -> None:
    """Writes guesses as a joint map, with the reasons as remarks, whose names begin with `_`.

    Raises:
        InputError: The folder cannot be written.
    """
    check_writable(path)
    entries: dict[str, str] = {"_": "Correct what is wrong; what begins with _ is ignored."}
    for name, guess in guesses.items():
        entries[name] = skeleton.names[guess.joint]
        entries[f"_{name}"] = guess.reason
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(entries, indent=1, ensure_ascii=False), encoding="utf-8")


class _Tree:
    """A skeleton's branches; `lines` holds the joints from the root to each joint."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton, self.rest = skeleton, skeleton.rest_joints()
        self.lines = [list(line[::-1]) for line in skeleton.lines]
        self.tips = [joint for joint in range(len(skeleton)) if not skeleton.children(joint)]
        size = np.ptp(self.rest, axis=0)
        # The vertical is y or z, whichever the figure extends along, unless it lies along x.
        vertical = int(np.argmax(size[1:])) + 1 if size[1:].max() > 0.8 * size[0] else 0
        self.up = np.eye(3)[vertical]
        self.heights = self.rest @ self.up

    def branches(self) -> tuple[list[list[int]], list[list[int]]]:
        """Returns legs and arms, each left and right, from where they part to their tips."""
        legs = self._pair(sorted(self.tips, key=lambda tip: self.heights[tip]))
        across = self.rest[legs[0][-1]] - self.rest[legs[1][-1]]
        across = across - self.up * (across @ self.up)
        across /= max(float(np.linalg.norm(across)), 1e-9)
        leg_joints = {joint for leg in legs for joint in leg}
        outward = sorted(
            self.tips, key=lambda tip: -abs(float((self.rest[tip] - self.rest[0]) @ across))
        )
        arms = self._pair([tip for tip in outward if not leg_joints & set(self.lines[tip])])
        # Names say which leg is the left one, else the toes, which point ahead.
        sides = [_named_side(self.skeleton.names[leg[-1]]) for leg in legs]
        if sides in (["left", "right"], ["right", "left"]):
            sign = 1.0 if sides[0] == "left" else -1.0
        else:
            toes = np.sum([self.rest[leg[-1]] - self.rest[leg[-2]] for leg in legs], axis=0)
            sign = 1.0 if np.cross(across, self.up) @ toes >= 0 else -1.0
        left = sign * across
        return self._sided(legs, left), self._sided(arms, left)

    def head(self, arms: list[list[int]]) -> Guess | None:
        """Returns a guess for the head: by its name, else the highest tip between the arms."""
        head = re.compile(f"(?i){_HEAD}(?!.*({_TIP}))")
        named = [joint for joint, name in enumerate(self.skeleton.names) if head.search(name)]
        if named:
            return Guess(named[0], "its name says head")
        arm_joints = {joint for arm in arms for joint in arm}
        free = [tip for tip in self.tips if not arm_joints & set(self.lines[tip])]
        highest = max(free, key=lambda tip: self.heights[tip], default=None)
        if highest is not None:
            is_tip = re.search(f"(?i)({_TIP})", self.skeleton.names[highest])
            if is_tip or highest in self.skeleton.end_sites:
                highest = self.skeleton.parents[highest]
        return None if highest is None else Guess(highest, "the highest tip between the arms")

    def _pair(self, tips: list[int]) -> list[list[int]]:
        """Returns the first two branches that part from each other, are long and much alike."""
        for number, first in enumerate(tips):
            for second in tips[:number]:
                shared = len([j for j in self.lines[first] if j in self.lines[second]])
                pair = [self.lines[tip][shared:] for tip in (second, first)]
                if min(map(len, pair)) < 3:
                    continue
                bones = [np.diff(self.rest[branch], axis=0) for branch in pair]
                lengths = [np.linalg.norm(branch, axis=-1).sum() for branch in bones]
                apart = np.linalg.norm(self.rest[second] - self.rest[first])
                ratio = lengths[0] / max(lengths[1], 1e-9)
                # Limbs of a pair are alike in length, up to the errors of a drawn skeleton, and lie
                # apart.
                if 0.8 < ratio < 1.25 and apart > 0.1 * lengths[0]:
                    return pair
        raise DataError(
            f"found no pair of legs and of arms in {self.skeleton.name!r}: expected branches of at "
            "least three joints on both sides; write the map of joints by hand"
        )

    def _sided(self, pair: list[list[int]], left: np.ndarray) -> list[list[int]]:
        return sorted(pair, key=lambda chain: -float(self.rest[chain[-1]] @ left))


def _by_words(tree: _Tree, side: str) -> dict[str, Guess]:
    """Returns limbs whose joints are named for their parts, in order down the tree."""
    names = tree.skeleton.names
    candidates = [j for j, name in enumerate(names) if _named_side(name) == side]
    candidates = [j for j in candidates if "twist" not in names[j].lower()]
    guesses: dict[str, Guess] = {}
    for limb in _LIMBS:
        above: int | None = None
        for part in limb:
            for joint in candidates:
                word = re.search(_WORDS[part], names[joint].lower())
                below = above is None or (above != joint and above in tree.lines[joint])
                if word is not None and below:
                    guesses[f"{side}_{part}"] = Guess(joint, f"its name says {side} and {word[0]}")
                    above = joint
                    break
    if f"{side}_shoulder" not in guesses and f"{side}_collar" in guesses:
        guesses[f"{side}_shoulder"] = guesses.pop(f"{side}_collar")
    return guesses


def _named_side(name: str) -> str | None:
    return next((side for side, words in _SIDE_WORDS.items() if re.search(words, name)), None)
