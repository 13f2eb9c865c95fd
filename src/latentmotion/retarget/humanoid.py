"""Humanoids: the joints of a foreign skeleton by our names, given or guessed, with reasons.

Names first: a limb is complete where joints are named for its parts, in order. Else geometry: legs
are the two branches that reach lowest, arms those that reach out farthest sideways; thigh and
shank, upper arm and forearm are the two longest bones of their branch.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from latentmotion.errors import DataError
from latentmotion.kinematics.humanoid import (
    NAME_MAPS,
    OPTIONAL,
    REQUIRED,
    VRM,
    JointMap,
    match,
    plain,
)
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.storage.files import atomic_file

SIDES = ("left", "right")
_LIMBS = (("hip", "knee", "ankle", "foot"), ("shoulder", "elbow", "wrist"))


@dataclass(frozen=True, eq=False)
class Humanoid:
    """A skeleton whose joints are known by the names of ours.

    Raises:
        DataError: Joints are missing, or do not hang on each other as a body's do.
    """

    skeleton: Skeleton
    """The skeleton with these joints."""
    joints: Mapping[str, int]
    """Our name → the joint's index."""
    names: str = "a map"
    """Naming convention, for messages."""
    lines: tuple[tuple[int, ...], ...] = field(init=False, repr=False)
    """For each joint itself and its ancestors, upward."""

    def __post_init__(self) -> None:
        lines: list[tuple[int, ...]] = []
        for joint, parent in enumerate(self.skeleton.parents):
            lines.append((joint, *(lines[parent] if parent >= 0 else ())))
        object.__setattr__(self, "lines", tuple(lines))
        names = self.skeleton.names
        missing = [name for name in REQUIRED if name not in self.joints]
        if missing:
            taken = set(self.joints.values())
            free = [name for joint, name in enumerate(names) if joint not in taken]
            raise DataError(
                f"found no {', '.join(missing)} in the rig; its joints without a part are "
                f"{', '.join(free[:60]) or 'none'}. Draft a map with --draft-map map.json, correct "
                "it, pass it with --map map.json"
            )
        for side, limb in product(SIDES, _LIMBS):
            chain = [f"{side}_{joint}" for joint in limb if f"{side}_{joint}" in self.joints]
            for upper, lower in pairwise(chain):
                a, b = self.joints[upper], self.joints[lower]
                if a == b or a not in self.lines[b]:
                    raise DataError(
                        f"{lower} ({names[b]!r}) does not hang on {upper} ({names[a]!r}); "
                        "correct the map of joints"
                    )

    @cached_property
    def pelvis(self) -> int:
        """The joint that carries legs and spine, and moves the whole."""
        hips = [self.joints[f"{side}_hip"] for side in SIDES]
        named = self.joints.get("pelvis")
        # Rigify's deforming pelvis does not carry its deforming thighs.
        if named is not None and all(named in self.lines[hip] for hip in hips):
            return named
        return self._shared([*hips, self.chest])

    @cached_property
    def chest(self) -> int:
        """The joint that carries arms and neck."""
        tops = [f"{side}_shoulder" for side in SIDES] + [
            "neck" if "neck" in self.joints else "head"
        ]
        joints = [self.joints[top] for top in tops if top in self.joints]
        return self._shared([self.skeleton.parents[joint] for joint in joints])

    @cached_property
    def spine(self) -> tuple[int, ...]:
        """Joints above the pelvis up to the chest."""
        return self._between(self.pelvis, self.chest)

    @cached_property
    def neck(self) -> tuple[int, ...]:
        """Joints above the chest up to below the head."""
        if "head" not in self.joints:
            return (self.joints["neck"],) if "neck" in self.joints else ()
        return self._between(self.chest, self.joints["head"])[:-1]

    def joint_map(self) -> JointMap:
        """Returns the map that reads positions of our 22 joints from this skeleton."""
        names = self.skeleton.names
        sources = {name: names[joint] for name, joint in self.joints.items()}
        spine = [self.pelvis, *self.spine]
        for number in (1, 2, 3):
            index = round(number / 3 * (len(spine) - 1))
            sources.setdefault(f"spine{number}", names[spine[index]])
        sources.setdefault("pelvis", names[self.pelvis])
        sources.setdefault("neck", names[self.neck[0]] if self.neck else names[self.chest])
        sources.setdefault("head", sources["neck"])
        for side in SIDES:
            sources.setdefault(f"{side}_collar", sources["neck"])
            sources.setdefault(f"{side}_foot", sources[f"{side}_ankle"])
        return sources

    def _shared(self, joints: list[int]) -> int:
        """Returns the lowest joint that all these equal or descend from."""
        shared = set(self.lines[joints[0]]).intersection(*(self.lines[joint] for joint in joints))
        return max(shared, key=lambda joint: len(self.lines[joint]))

    def _between(self, above: int, joint: int) -> tuple[int, ...]:
        line = self.lines[joint]
        return line[: line.index(above)][::-1] if above in line else ()


def find_humanoid(skeleton: Skeleton, declared: Mapping[str, int] | None = None) -> Humanoid:
    """Finds our joints in a skeleton by its names.

    Args:
        skeleton: Any skeleton.
        declared: VRM's names of its joints, where the file itself has them.

    Raises:
        DataError: The names are unknown, or a joint is missing; the message says which.
    """
    if declared:
        bones = {plain(name): joint for name, joint in declared.items()}
        joints = {ours: bones[name[0]] for ours, name in VRM.items() if name[0] in bones}
        return Humanoid(skeleton, joints, "VRM humanoid")
    matches = {name: match(skeleton.names, names) for name, names in NAME_MAPS.items()}
    required = {name: len(set(REQUIRED) & set(joints)) for name, joints in matches.items()}
    best = max(matches, key=lambda name: (required[name], len(matches[name])))
    if required[best] < len(REQUIRED) // 2:
        raise DataError(
            f"unknown names: found the joints {_listed(skeleton)}; known are the names of "
            f"{', '.join(NAME_MAPS)}. Draft a map with --draft-map map.json, correct it, pass it "
            "with --map map.json"
        )
    return Humanoid(skeleton, matches[best], best)


def humanoid_of_map(skeleton: Skeleton, joint_map: JointMap) -> Humanoid:
    """Returns the joints that a map names; entries whose name begins with `_` are remarks.

    Raises:
        DataError: The map names joints that are not there, or lacks one that is needed.
    """
    entries = {name: source for name, source in joint_map.items() if not name.startswith("_")}
    known = (*REQUIRED, *OPTIONAL)
    for name in entries:
        if name not in known:
            raise DataError(
                f"the map has {name!r}{_near(name, known)}; known are {', '.join(known)}"
            )
    index = {name: joint for joint, name in reversed(list(enumerate(skeleton.names)))}
    joints = {}
    for name, source in entries.items():
        joint = source if isinstance(source, str) else max(source, key=source.__getitem__)
        if joint not in index:
            raise DataError(
                f"the map says {name!r} is {joint!r}, which is none of the rig's joints"
                f"{_near(joint, skeleton.names)}; it has {_listed(skeleton)}"
            )
        joints[name] = index[joint]
    return Humanoid(skeleton, joints)


def _near(name: str, names: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""


def _listed(skeleton: Skeleton) -> str:
    more = len(skeleton) - 60
    return ", ".join(skeleton.names[:60]) + (f" and {more} more" if more > 0 else "")


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
_NAMED_LIMBS = (("hip", "knee", "ankle", "foot"), ("collar", "shoulder", "elbow", "wrist"))
_SIDE_WORDS = {
    "left": r"(?i:left|links)|(^|[^a-z])[lL]([^a-z]|$)|^l(?=[A-Z])",
    "right": r"(?i:right|rechts)|(^|[^a-z])[rR]([^a-z]|$)|^r(?=[A-Z])",
}


@dataclass(frozen=True)
class Guess:
    """A guess for one of our joints."""

    joint: int
    """The rig's joint."""
    reason: str
    """The reason, for people to check."""


def draft_map(skeleton: Skeleton) -> dict[str, Guess]:
    """Guesses which joint of any skeleton is which of ours.

    Raises:
        DataError: There are no two branches that could be legs.
    """
    tree = _Tree(skeleton)
    guesses = {name: guess for side in SIDES for name, guess in _by_words(tree, side).items()}
    legs, arms = tree.branches()
    for limb, pair in ((_NAMED_LIMBS[0], legs), (_NAMED_LIMBS[1], arms)):
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
        guesses["head"] = head
    return guesses


def write_draft(path: str | Path, skeleton: Skeleton, guesses: Mapping[str, Guess]) -> None:
    """Writes guesses as a joint map, with the reasons as remarks, whose names begin with `_`.

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
    """A skeleton's branches; `lines` holds the joints from the root to each joint."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.skeleton, self.rest = skeleton, skeleton.rest_joints()
        self.lines: list[list[int]] = []
        for joint, parent in enumerate(skeleton.parents):
            self.lines.append([*(self.lines[parent] if parent >= 0 else []), joint])
        self.tips = [joint for joint in range(len(skeleton)) if not skeleton.children(joint)]
        size = np.ptp(self.rest, axis=0)
        vertical = int(np.argmax(size[1:])) + 1 if size[1:].max() > 0.8 * size[0] else 0
        self.up = np.eye(3)[vertical]
        self.heights = self.rest @ self.up

    def branches(self) -> tuple[list[list[int]], list[list[int]]]:
        """Returns legs and arms, each left and right, from where they part to their tips."""
        legs = self._pair(sorted(self.tips, key=lambda tip: self.heights[tip]))
        across = self.rest[legs[0][-1]] - self.rest[legs[1][-1]]
        across = across - self.up * (across @ self.up)
        across /= max(float(np.linalg.norm(across)), 1e-9)
        taken = {joint for leg in legs for joint in leg}
        outward = sorted(
            self.tips, key=lambda tip: -abs(float((self.rest[tip] - self.rest[0]) @ across))
        )
        arms = self._pair([tip for tip in outward if not taken & set(self.lines[tip])])
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
        named = [
            j for j, n in enumerate(self.skeleton.names) if re.search("(?i)head(?!.*(top|end))", n)
        ]
        if named:
            return Guess(named[0], "its name says head")
        taken = {joint for arm in arms for joint in arm}
        free = [tip for tip in self.tips if not taken & set(self.lines[tip])]
        highest = max(free, key=lambda tip: self.heights[tip], default=None)
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
    for limb in _NAMED_LIMBS:
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
