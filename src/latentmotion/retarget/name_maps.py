"""Names of joints in the programs animators use, and which of our joints each of them is.

Spines need no names: they are the joints between pelvis and chest, however many there are.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from latentmotion.kinematics.humanoid import JOINT_MAPS
from latentmotion.kinematics.skeleton import HUMANML3D

NameMap = Mapping[str, tuple[str, ...]]
"""One of our joints → the names it may have, `plain`, the likeliest first."""

LIMB_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
"""What every rig must have on both sides."""

REQUIRED = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in LIMB_JOINTS)
"""Joints without which nothing can be carried over."""

OPTIONAL = (
    *("pelvis", "neck", "head", "left_collar", "right_collar", "left_foot", "right_foot"),
    *("spine1", "spine2", "spine3"),
)
"""Joints that are found from the others, or left at rest, where a rig does not have them."""

_PREFIX = re.compile(
    r"^(.*[:|])?(mixamorig\d*[_:]?)?(?P<kind>def|org)?(?(kind)[-_])", re.IGNORECASE
)
_NUMBER = re.compile(r"_\d+$")


def plain(name: str) -> str:
    """Returns a name without namespace, `mixamorig`, `DEF-`, punctuation and capitals."""
    return re.sub(r"[^a-z0-9]", "", _PREFIX.sub("", name, count=1).lower())


def unnumbered(name: str) -> str:
    """Returns a name without the number that exporters append: `Hips_01`."""
    return _NUMBER.sub("", name)


def _sides(left: str, right: str, middle: Mapping[str, str], side: Mapping[str, str]) -> NameMap:
    """Completes a map. `@` stands for a side, `/` parts names that a joint may have."""
    names = {joint: tuple(words.split("/")) for joint, words in middle.items()}
    for whole, letter in (("left", left), ("right", right)):
        for joint, words in side.items():
            names[f"{whole}_{joint}"] = tuple(words.replace("@", letter).split("/"))
    return names


def _of_joint_map(name: str) -> NameMap:
    """Takes the joints of a map for reading mocap that it reads from one joint alone."""
    single = {
        joint: source if isinstance(source, str) else max(source, key=source.__getitem__)
        for joint, source in JOINT_MAPS[name].items()
        if joint.partition("_")[0] in ("left", "right") or joint in ("neck", "head")
    }
    return {joint: (plain(source),) for joint, source in single.items()}


UNREAL = _sides(
    *("l", "r", {"pelvis": "pelvis", "neck": "neck01", "head": "head"}),
    {
        **{"hip": "thigh@", "knee": "calf@", "ankle": "foot@", "foot": "ball@"},
        **{"collar": "clavicle@", "shoulder": "upperarm@", "elbow": "lowerarm@", "wrist": "hand@"},
    },
)
VROID = _sides(
    *("l", "r", {"pelvis": "jbipchips", "neck": "jbipcneck", "head": "jbipchead"}),
    {
        **{"hip": "jbip@upperleg", "knee": "jbip@lowerleg", "ankle": "jbip@foot"},
        **{"foot": "jbip@toebase", "collar": "jbip@shoulder", "shoulder": "jbip@upperarm"},
        **{"elbow": "jbip@lowerarm", "wrist": "jbip@hand"},
    },
)
VRM = _sides(
    *("left", "right", {"pelvis": "hips", "neck": "neck", "head": "head"}),
    {
        **{"hip": "@upperleg", "knee": "@lowerleg", "ankle": "@foot", "foot": "@toes"},
        **{"collar": "@shoulder", "shoulder": "@upperarm", "elbow": "@lowerarm", "wrist": "@hand"},
    },
)
"""The bones of VRM's humanoid, which are Unity's too."""

RIGIFY = _sides(
    *("l", "r", {"pelvis": "spine/hips", "neck": "spine004/neck", "head": "spine006/head"}),
    {
        **{"hip": "thigh@", "knee": "shin@", "ankle": "foot@", "foot": "toe@"},
        **{"collar": "shoulder@", "shoulder": "upperarm@", "elbow": "forearm@", "wrist": "hand@"},
    },
)
GENESIS = _sides(
    *("l", "r", {"neck": "necklower/neck1/neck", "head": "head"}),
    {
        **{"hip": "@thighbend/@thigh", "knee": "@shin", "ankle": "@foot", "foot": "@toe/@toes"},
        **{"collar": "@collar/@shoulder", "shoulder": "@shldrbend/@shldr/@upperarm"},
        **{"elbow": "@forearmbend/@forearm", "wrist": "@hand"},
    },
)
"""Daz Genesis 3, 8 and 9."""

SMPL = _sides(
    *("l", "r", {"pelvis": "pelvis", "neck": "neck", "head": "head"}),
    {joint: f"@{joint}" for joint in (*LIMB_JOINTS, "foot", "collar")},
)
BIPED = _sides(
    *("l", "r", {"pelvis": "bip01pelvis", "neck": "bip01neck", "head": "bip01head"}),
    {
        **{"hip": "bip01@thigh", "knee": "bip01@calf", "ankle": "bip01@foot"},
        **{"foot": "bip01@toe0", "collar": "bip01@clavicle", "shoulder": "bip01@upperarm"},
        **{"elbow": "bip01@forearm", "wrist": "bip01@hand"},
    },
)
OURS = {name: (plain(name),) for name in HUMANML3D.names}

NAME_MAPS: Mapping[str, NameMap] = MappingProxyType(
    {
        **{"Latent Motion": OURS, "Mixamo": _of_joint_map("mixamo"), "Unreal": UNREAL},
        **{"VRM": VRM, "VRoid": VROID, "Rigify": RIGIFY, "Daz Genesis": GENESIS},
        **{"Daz BVH": _of_joint_map("daz"), "Acclaim": _of_joint_map("acclaim")},
        **{"SMPL": SMPL, "Biped": BIPED},
    }
)
"""The names that are known, tried in this order. MotionBuilder's are Mixamo's."""


def match(names: Sequence[str], name_map: NameMap) -> dict[str, int]:
    """Returns the joints of ours that are found, and where among `names`.

    Where several joints share a plain name, as Rigify's `DEF-`, `ORG-` and controls do, the one
    that deforms the mesh is meant.
    """
    places: dict[str, int] = {}
    for form in (unnumbered, str):
        for place in sorted(range(len(names)), key=lambda n: (_rank(names[n]), -n)):
            places[plain(form(names[place]))] = place
    found = {joint: [places[n] for n in words if n in places] for joint, words in name_map.items()}
    return {joint: where[0] for joint, where in found.items() if where}


def _rank(name: str) -> int:
    return next((rank for word, rank in (("def-", 2), ("org-", 1)) if word in name.lower()), 0)
