"""Humanoids: which joints of a foreign skeleton are ours, and the chains of joints between them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

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

SIDES = ("left", "right")


@dataclass(frozen=True, eq=False)
class Humanoid:
    """A skeleton whose joints are known by the names of ours.

    Raises:
        DataError: Joints are missing, or do not hang on each other as a body's do.
    """

    skeleton: Skeleton
    """Whose joints they are."""
    joints: Mapping[str, int]
    """One of our names → the joint."""
    names: str = "a map"
    """Whose names they are, for people to read."""
    lines: tuple[tuple[int, ...], ...] = field(init=False, repr=False)
    """For each joint itself and those above it, upward."""

    def __post_init__(self) -> None:
        lines: list[tuple[int, ...]] = []
        for joint, parent in enumerate(self.skeleton.parents):
            lines.append((joint, *(lines[parent] if parent >= 0 else ())))
        object.__setattr__(self, "lines", tuple(lines))
        _check_complete(self.skeleton, self.joints)
        for side in SIDES:
            for chain in (("hip", "knee", "ankle", "foot"), ("shoulder", "elbow", "wrist")):
                self._check_chain([f"{side}_{joint}" for joint in chain])

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
        found = {name: names[joint] for name, joint in self.joints.items()}
        spine = [self.pelvis, *self.spine]
        for number in (1, 2, 3):
            place = round(number / 3 * (len(spine) - 1))
            found.setdefault(f"spine{number}", names[spine[place]])
        found.setdefault("pelvis", names[self.pelvis])
        found.setdefault("neck", names[self.neck[0]] if self.neck else names[self.chest])
        found.setdefault("head", found["neck"])
        for side in SIDES:
            found.setdefault(f"{side}_collar", found["neck"])
            found.setdefault(f"{side}_foot", found[f"{side}_ankle"])
        return found

    def _shared(self, joints: list[int]) -> int:
        """Returns the lowest joint that all these are, or hang on."""
        shared = set(self.lines[joints[0]]).intersection(*(self.lines[joint] for joint in joints))
        return max(shared, key=lambda joint: len(self.lines[joint]))

    def _between(self, above: int, joint: int) -> tuple[int, ...]:
        line = self.lines[joint]
        return line[: line.index(above)][::-1] if above in line else ()

    def _check_chain(self, names: list[str]) -> None:
        found = [name for name in names if name in self.joints]
        for upper, lower in pairwise(found):
            a, b = self.joints[upper], self.joints[lower]
            if a == b or a not in self.lines[b]:
                words = self.skeleton.names
                raise DataError(
                    f"{lower} ({words[b]!r}) does not hang on {upper} ({words[a]!r}); "
                    "correct the map of joints"
                )


def find_humanoid(skeleton: Skeleton, declared: Mapping[str, int] | None = None) -> Humanoid:
    """Finds the joints of ours in a skeleton by its names.

    Args:
        skeleton: Any skeleton.
        declared: VRM's names of its joints, where the file itself says them.

    Raises:
        DataError: The names are unknown, or a joint is missing; the message says which.
    """
    if declared:
        words = {plain(name): joint for name, joint in declared.items()}
        found = {ours: words[name[0]] for ours, name in VRM.items() if name[0] in words}
        return Humanoid(skeleton, found, "VRM humanoid")
    finds = {name: match(skeleton.names, names) for name, names in NAME_MAPS.items()}
    best = max(finds, key=lambda name: (len(set(REQUIRED) & set(finds[name])), len(finds[name])))
    if len(set(REQUIRED) & set(finds[best])) < len(REQUIRED) // 2:
        raise DataError(
            f"unknown names: found the joints {_listed(skeleton)}; known are the names of "
            f"{', '.join(NAME_MAPS)}. Draft a map with --draft-map map.json, correct it, pass it "
            "with --map map.json"
        )
    return Humanoid(skeleton, finds[best], best)


def humanoid_of_map(skeleton: Skeleton, joint_map: JointMap) -> Humanoid:
    """Takes the joints that a map names; entries whose name begins with `_` are remarks.

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
    places = {name: place for place, name in reversed(list(enumerate(skeleton.names)))}
    joints = {}
    for name, source in entries.items():
        joint = source if isinstance(source, str) else max(source, key=source.__getitem__)
        if joint not in places:
            raise DataError(
                f"the map says {name!r} is {joint!r}, which is none of the rig's joints"
                f"{_near(joint, skeleton.names)}; it has {_listed(skeleton)}"
            )
        joints[name] = places[joint]
    return Humanoid(skeleton, joints)


def _check_complete(skeleton: Skeleton, joints: Mapping[str, int]) -> None:
    missing = [name for name in REQUIRED if name not in joints]
    if missing:
        taken = set(joints.values())
        free = [name for n, name in enumerate(skeleton.names) if n not in taken]
        raise DataError(
            f"found no {', '.join(missing)} in the rig; its joints without a part are "
            f"{', '.join(free[:60]) or 'none'}. Draft a map with --draft-map map.json, correct "
            "it, pass it with --map map.json"
        )


def _near(name: str, names: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""


def _listed(skeleton: Skeleton) -> str:
    more = len(skeleton) - 60
    return ", ".join(skeleton.names[:60]) + (f" and {more} more" if more > 0 else "")
