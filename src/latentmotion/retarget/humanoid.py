"""Humanoids: the joints of a foreign skeleton by our names, and the chains between them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise, product

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
