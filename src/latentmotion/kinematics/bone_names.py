"""Names of bones: which joints of a foreign skeleton are ours, by what programs call them.

One table for all readers, `bone_names.toml`. A naming convention lists the names of each of our
joints as `plain` writes them, the likeliest first; whole rigs may put anything before and behind
(`Bob_`, `CC_Base_`, `_jnt`). Names must match whole, so that twist, roll, IK and helper bones are
never taken for limbs. Spines need no names: they are all joints between pelvis and chest.

Skeletons of the data sets also have joint maps, which say where positions are read.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cache
from typing import Any

from latentmotion.errors import DataError
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.plugins import plugins, warn_of
from latentmotion.storage.reading import packaged_toml

# HumanML3D's name → a source joint, or the weights of several that sum to 1.
JointMap = Mapping[str, str | Mapping[str, float]]

_NAMESPACE = re.compile(r"^(.*:)?(mixamorig\d*_?)?", re.IGNORECASE)


def weights_of(source: str | Mapping[str, float]) -> Mapping[str, float]:
    """Returns the weights of an entry of a joint map."""
    return {source: 1.0} if isinstance(source, str) else source


def without_namespace(name: str) -> str:
    """Returns the name without a namespace (`Bob:`) and without `mixamorig`."""
    return _NAMESPACE.sub("", name, count=1) or name


def find_joint_map(names: Sequence[str]) -> JointMap | None:
    """Returns the first map whose source joints are all among `names`, if any.

    Plugins' maps come last, for names that no convention explains.
    """
    plain_names = {without_namespace(name) for name in names}

    def fits(joint_map: JointMap) -> bool:
        sources = (source for entry in joint_map.values() for source in weights_of(entry))
        return plain_names.issuperset(map(without_namespace, sources))

    fitting = next(filter(fits, joint_maps().values()), None)
    if fitting is None and match_names(names).missing:
        fitting = next(filter(fits, added_joint_maps().values()), None)
    return fitting


def added_joint_maps() -> dict[str, JointMap]:
    """Returns the joint maps of the plugins of `latentmotion.skeletons` by name."""
    added = plugins("latentmotion.skeletons")
    for name in list(added):
        if not is_joint_map(added[name]) or set(added[name]) != set(HUMANML3D.names):
            error = DataError(f"expected a joint map of {', '.join(HUMANML3D.names)}")
            warn_of("latentmotion.skeletons", name, error)
            del added[name]
    return added


def is_joint_map(value: object) -> bool:
    """Returns whether a value maps names to names, or to weights that sum to 1."""
    valid = isinstance(value, Mapping)
    for source in value.values() if isinstance(value, Mapping) else ():
        weights = source.values() if isinstance(source, Mapping) else ()
        numeric = all(isinstance(weight, int | float) for weight in weights)
        valid &= isinstance(source, str) or (numeric and abs(sum(weights) - 1) < 1e-6)
    return valid


# One of our joints → the names it may have, `plain`, the likeliest first.
NameMap = Mapping[str, tuple[str, ...]]

SIDES = ("left", "right")

# Meters from the wrist to the middle of the palm and to the tip of the middle finger.
BEYOND_WRIST: Mapping[str, float] = {"hand": 0.09, "fingertips": 0.18}

# Joints that every rig must have on both sides.
LIMB_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")

# Joints without which a skeleton is no body.
REQUIRED = tuple(f"{side}_{joint}" for side in SIDES for joint in LIMB_JOINTS)

# Joints that are derived from the others, or stay at rest, if a rig lacks them.
OPTIONAL = (
    *("pelvis", "neck", "head", "left_collar", "right_collar", "left_foot", "right_foot"),
    *("spine1", "spine2", "spine3"),
)

_PREFIX = re.compile(
    r"^(.*[:|])?(mixamorig\d*[_:]?)?(?P<kind>def|org)?(?(kind)[-_])", re.IGNORECASE
)
_NUMBER = re.compile(r"[_.]\d+$")


def plain(name: str) -> str:
    """Returns a name without namespace, `mixamorig`, `DEF-`, punctuation and capitals."""
    return re.sub(r"[\W_]", "", _PREFIX.sub("", name, count=1).lower())


_SIDE_PARTS = ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist")


@cache
def _tables() -> dict[str, dict[str, Any]]:
    return packaged_toml(__file__, "bone_names.toml")


@cache
def joint_maps() -> Mapping[str, JointMap]:
    """Returns all joint maps by name, in the order in which they are tried."""
    maps: dict[str, JointMap] = {"humanml3d": {name: name for name in HUMANML3D.names}}
    for name, table in _tables()["joint_maps"].items():
        entries = {joint: source for joint, source in table.items() if joint != "sides"}
        joints = {j: source for j, source in entries.items() if j not in _SIDE_PARTS}
        for side, mark in zip(SIDES, table["sides"].split("/"), strict=True):
            for joint in (joint for joint in entries if joint in _SIDE_PARTS):
                weights = weights_of(entries[joint]).items()
                joints[f"{side}_{joint}"] = {s.replace("@", mark): w for s, w in weights}
        maps[name] = joints
    return maps


@cache
def name_maps() -> Mapping[str, NameMap]:
    """Returns all naming conventions by name, in the order in which they are tried."""
    maps: dict[str, NameMap] = {"Latent Motion": {name: (plain(name),) for name in HUMANML3D.names}}
    for name, row in _tables()["conventions"].items():
        if isinstance(row, str):  # the joints of a joint map that have a single or a main source
            maps[name] = {
                joint: (plain(max(weights_of(source).items(), key=lambda item: item[1])[0]),)
                for joint, source in joint_maps()[row].items()
                if joint.partition("_")[0] in SIDES or joint in ("neck", "head")
            }
            continue
        marks, middle, side = row
        words = dict(zip(("pelvis", "neck", "head"), middle.split(), strict=True))
        for whole, mark in zip(SIDES, marks.split("/"), strict=True):
            marked = side.replace("@", mark).split()
            words |= dict(zip((f"{whole}_{p}" for p in _SIDE_PARTS), marked, strict=True))
        maps[name] = {joint: tuple(spelled.split("/")) for joint, spelled in words.items()}
    return maps


@dataclass(frozen=True)
class NameMatch:
    """The joints that a convention finds in a skeleton."""

    convention: str  # Name of the convention, a key of `name_maps`.
    joints: Mapping[str, int]  # Our joints that were found, and their indices.

    @property
    def missing(self) -> tuple[str, ...]:
        """Required joints that were not found."""
        return tuple(name for name in REQUIRED if name not in self.joints)


def match_names(names: Sequence[str]) -> NameMatch:
    """Maps the names of a skeleton's joints to ours, by the convention that finds most of them.

    Where several joints share a plain name, as Rigify's `DEF-`, `ORG-` and controls do, the one
    that deforms the mesh is meant. Numbers that exporters append (`Hips_01`) do not matter, nor
    what all names of a rig begin or end with.
    """
    deforming = (("def-", 2), ("org-", 1))
    ranks = [next((n for word, n in deforming if word in name.lower()), 0) for name in names]
    index: dict[str, int] = {}
    for unnumbered in (True, False):
        for number in sorted(range(len(names)), key=lambda n: (ranks[n], -n)):
            index[plain(_NUMBER.sub("", names[number]) if unnumbered else names[number])] = number
    matches = [NameMatch(name, _matched(index, words)) for name, words in name_maps().items()]
    return min(matches, key=lambda match: (len(match.missing), -len(match.joints)))


def _matched(index: Mapping[str, int], name_map: NameMap) -> dict[str, int]:
    """Returns the joints whose names are those of a convention, or all with the same affixes."""

    def joints(before: str, behind: str) -> dict[str, int]:
        spelled = {
            joint: [f"{before}{word}{behind}" for word in words]
            for joint, words in name_map.items()
        }
        hits = {joint: [index[w] for w in words if w in index] for joint, words in spelled.items()}
        return {joint: numbers[0] for joint, numbers in hits.items() if numbers}

    whole = joints("", "")
    if all(name in whole for name in REQUIRED):
        return whole
    affixes: Counter[tuple[str, str]] = Counter()
    for name in REQUIRED:
        partitions = (key.partition(word) for word in name_map[name] for key in index)
        affixes.update({(before, behind) for before, word, behind in partitions if word})
    for (before, behind), count in affixes.items():
        if count == len(REQUIRED):  # of a whole body: twists and IK targets are never that
            return joints(before, behind)
    return whole


# Words for limbs in most conventions.
_PARTS = (
    *("thigh", "upleg", "upperleg", "hip", "calf", "shin", "knee", "lowerleg", "foot", "ankle"),
    *("upperarm", "shoulder", "forearm", "lowerarm", "elbow", "hand", "wrist"),
)


def nearest(names: Iterable[str], words: Iterable[str] = (), count: int = 10) -> str:
    """Returns the names that look most like some words, by default limbs', as a list to print."""
    targets = [plain(word) for word in words] or _PARTS
    matchers = [SequenceMatcher(b=target, autojunk=False) for target in targets]

    def likeness(name: str) -> float:
        for matcher in matchers:
            matcher.set_seq1(plain(name)[:40])
        return max(matcher.ratio() for matcher in matchers)

    likeliest = sorted(dict.fromkeys(names), key=likeness, reverse=True)[:count]
    shown = [name if len(name) <= 40 else f"{name[:39]}…" for name in likeliest]
    return ", ".join(map(repr, shown)) or "none"


def names_of(joints: Iterable[str], convention: str) -> list[str]:
    """Returns the names that joints have in a convention; those of ours where it has none."""
    words = name_maps().get(convention, {})
    return [word for joint in joints for word in words.get(joint, (joint,))]
