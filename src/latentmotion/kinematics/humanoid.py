"""Names of joints in foreign skeletons: which of them are HumanML3D's 22.

A joint map says from which joints to read positions, a name map which bones of a rig to move.

Joint maps. Each of the 22 is one source joint, or a weighted mean of several where the source has
no such point (Acclaim's clavicles start at the spine, SMPL's in front of the shoulder). The weights
put the point where SMPL's rest pose has it between its neighbors.

Name maps. The names that animation programs give to bones. Spines need none: they are all joints
between pelvis and chest.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from latentmotion.errors import DataError, FileFormatError
from latentmotion.kinematics.skeleton import HUMANML3D, Animation
from latentmotion.storage.reading import read_json_file

JointMap = Mapping[str, str | Mapping[str, float]]
"""HumanML3D's name → a source joint, or the weights of several that sum to 1."""

_NAMESPACE = re.compile(r"^(.*:)?(mixamorig\d*_?)?", re.IGNORECASE)


def _weights(source: str | Mapping[str, float]) -> Mapping[str, float]:
    return {source: 1.0} if isinstance(source, str) else source


def _symmetric(middle: JointMap, side: JointMap, left: str, right: str) -> JointMap:
    """Completes a map: `@` in the source names of `side` stands for the prefix of either side."""
    joints = dict(middle)
    for name, prefix in (("left", left), ("right", right)):
        for joint, source in side.items():
            weights = _weights(source).items()
            joints[f"{name}_{joint}"] = {s.replace("@", prefix): w for s, w in weights}
    return joints


_BIPED_SIDE = {
    **{"hip": "@UpLeg", "knee": "@Leg", "ankle": "@Foot", "foot": "@ToeBase"},
    **{"shoulder": "@Arm", "elbow": "@ForeArm", "wrist": "@Hand"},
}

ACCLAIM = _symmetric(
    {
        **{"pelvis": "root", "spine1": "upperback", "spine2": "thorax"},
        **{"spine3": {"thorax": 0.66, "lowerneck": 0.34}, "neck": "upperneck", "head": "head"},
    },
    {
        **{"hip": "@femur", "knee": "@tibia", "ankle": "@foot", "foot": "@toes"},
        **{"collar": {"@clavicle": 0.63, "@humerus": 0.37}, "shoulder": "@humerus"},
        **{"elbow": "@radius", "wrist": "@hand"},
    },
    left="l",
    right="r",
)
"""ASF of CMU and HDM05, as `read_asf_amc` names joints: by the bone that starts there.

Acclaim's `wrist` bone is the forearm's last third, where it twists; the hand starts at its end.
"""

MOTIONBUILDER = _symmetric(
    {
        **{"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "head": "Head"},
        **{"spine3": {"Spine1": 0.66, "Neck": 0.34}, "neck": "Neck1"},
    },
    {**_BIPED_SIDE, "collar": {"@Shoulder": 0.63, "@Arm": 0.37}},
    left="Left",
    right="Right",
)
"""cgspeed's MotionBuilder-friendly BVH of CMU: Acclaim's bones under other names.

It leaves out Acclaim's `wrist` bone, so its forearms are a third too short.
"""

DAZ = _symmetric(
    {
        # Its `hip` sits below the legs' joints, SMPL's pelvis above them.
        **{"pelvis": {"hip": 0.45, "abdomen": 0.55}, "spine1": "abdomen", "spine2": "chest"},
        **{"spine3": {"chest": 0.82, "neck": 0.18}, "neck": "neck", "head": "head"},
    },
    {
        **{"hip": "@Thigh", "knee": "@Shin", "ankle": "@Foot", "foot": "@Foot_end"},
        **{"collar": {"chest": 0.27, "@Collar": 0.48, "@Shldr": 0.25}, "shoulder": "@Shldr"},
        **{"elbow": "@ForeArm", "wrist": "@Hand"},
    },
    left="l",
    right="r",
)
"""cgspeed's Daz-friendly BVH of CMU: no toe joints, so the end sites of the feet are the toes."""

MIXAMO = _symmetric(
    {
        **{"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2"},
        **{"neck": "Neck", "head": "Head"},
    },
    {**_BIPED_SIDE, "collar": "@Shoulder"},
    left="Left",
    right="Right",
)
"""Mixamo, with or without `mixamorig:` before each name."""

SNU_COURT = _symmetric(
    {
        **{"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2"},
        **{"neck": "Neck", "head": "Head"},
    },
    {**_BIPED_SIDE, "foot": "@Toe", "collar": "@Shoulder"},
    left="Left",
    right="Right",
)
"""Seoul National University's basketball and martial arts."""


def _snu_studio(root: str, head: str) -> JointMap:
    """The skeleton of Seoul National University's studio, whose root and head go by two names."""
    middle: JointMap = {
        **{"pelvis": root, "spine1": "Spine", "spine2": {"Spine": 0.5, "Spine1": 0.5}},
        **{"spine3": "Spine1", "neck": head, "head": {head: 0.45, f"{head}_end": 0.55}},
    }
    joints = _symmetric(middle, {**_BIPED_SIDE, "foot": "@Toes"}, left="Left", right="Right")
    return {**joints, "left_collar": "LeftShoulder1", "right_collar": "RightShoulder"}


IDENTITY: JointMap = {name: name for name in HUMANML3D.names}
"""HumanML3D's own names."""

JOINT_MAPS: Mapping[str, JointMap] = {
    "humanml3d": IDENTITY,
    "acclaim": ACCLAIM,
    "daz": DAZ,
    "motionbuilder": MOTIONBUILDER,
    "mixamo": MIXAMO,
    "snu_court": SNU_COURT,
    "snu_studio_inches": _snu_studio("Hips", "Head"),
    "snu_studio_centimeters": _snu_studio("Hips", "HEad"),
    "snu_studio_asf": _snu_studio("root", "HEad"),
}
"""The maps tried in turn: the first whose source joints are all there is taken."""


def to_humanml3d(
    animation: Animation, joint_map: JointMap | None = None
) -> Float[np.ndarray, "frames 22 3"]:
    """Returns the positions of HumanML3D's 22 joints in an animation of another skeleton.

    Positions stay where they are: neither bone lengths, floor nor facing change.

    Args:
        animation: Any body, y up, in meters.
        joint_map: The source of each of the 22; by default found by the names.

    Raises:
        DataError: The skeleton is unknown, or the map names joints that are not there.
    """
    if joint_map is None:
        joint_map = find_joint_map(animation.skeleton.names)
    missing = [name for name in HUMANML3D.names if name not in joint_map]
    if missing:
        raise DataError(f"the joint map lacks {', '.join(missing)}; name a joint for each")
    names = animation.skeleton.names
    numbered = list(enumerate(names))[::-1]  # the first of joints that share a name counts
    columns = {_without_namespace(name): column for column, name in numbered}
    columns |= {name: column for column, name in numbered}
    weights = np.zeros((len(HUMANML3D), len(names)))
    for row, name in enumerate(HUMANML3D.names):
        for source, weight in _weights(joint_map[name]).items():
            column = columns.get(source, columns.get(_without_namespace(source)))
            if column is None:
                near = difflib.get_close_matches(source, names, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise DataError(
                    f"the joint map names {source!r}, but the skeleton has {', '.join(names)}{hint}"
                )
            weights[row, column] += weight
    return np.einsum("hj,fjc->fhc", weights, animation.joints(), optimize=True)


def find_joint_map(names: Sequence[str]) -> JointMap:
    """Returns the first of `JOINT_MAPS` whose source joints are all among `names`.

    Raises:
        DataError: There is none; the message lists the names and says how to pass a map.
    """
    known = {_without_namespace(name) for name in names}
    for joint_map in JOINT_MAPS.values():
        if all(
            _without_namespace(source) in known
            for joint in joint_map.values()
            for source in _weights(joint)
        ):
            return joint_map
    raise DataError(
        f"unknown skeleton: found the joints {', '.join(names)}; known are the skeletons "
        f"{', '.join(JOINT_MAPS)}. Pass a joint map: a dictionary, or a JSON file, from each of "
        f"{', '.join(HUMANML3D.names)} to one of the joints found"
    )


def load_joint_map(path: str | Path) -> JointMap:
    """Reads a joint map from a JSON file such as `{"pelvis": "Hips", "spine1": "Spine", …}`.

    Raises:
        FileFormatError: The file cannot be read or holds something else.
    """
    joint_map = read_json_file(path)
    valid = isinstance(joint_map, dict)
    for source in joint_map.values() if valid else ():
        weights = source.values() if isinstance(source, dict) else ()
        numeric = all(isinstance(weight, int | float) for weight in weights)
        valid &= isinstance(source, str) or (numeric and abs(sum(weights) - 1) < 1e-6)
    if not valid:
        raise FileFormatError(
            path,
            'expected an object such as {"pelvis": "Hips", …}; a value is the name of a joint, '
            "or an object of weights that sum to 1",
        )
    return joint_map


def _without_namespace(name: str) -> str:
    """Returns the name without a namespace (`Bob:`) and without `mixamorig`."""
    return _NAMESPACE.sub("", name, count=1) or name


NameMap = Mapping[str, tuple[str, ...]]
"""One of our joints → the names it may have, `plain`, the likeliest first."""

LIMB_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
"""Joints that every rig must have on both sides."""

REQUIRED = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in LIMB_JOINTS)
"""Joints without which nothing can be retargeted."""

OPTIONAL = (
    *("pelvis", "neck", "head", "left_collar", "right_collar", "left_foot", "right_foot"),
    *("spine1", "spine2", "spine3"),
)
"""Joints that are derived from the others, or stay at rest, if a rig lacks them."""

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
    """Returns the joints of a joint map that have a single or a main source."""
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
"""Known naming conventions, tried in this order. MotionBuilder's is Mixamo's."""


def match(names: Sequence[str], name_map: NameMap) -> dict[str, int]:
    """Returns our joints that are found, and their indices in `names`.

    Where several joints share a plain name, as Rigify's `DEF-`, `ORG-` and controls do, the one
    that deforms the mesh is meant.
    """
    deforming = (("def-", 2), ("org-", 1))
    ranks = [next((n for word, n in deforming if word in name.lower()), 0) for name in names]
    index: dict[str, int] = {}
    for form in (unnumbered, str):
        for number in sorted(range(len(names)), key=lambda n: (ranks[n], -n)):
            index[plain(form(names[number]))] = number
    matches = {joint: [index[n] for n in words if n in index] for joint, words in name_map.items()}
    return {joint: numbers[0] for joint, numbers in matches.items() if numbers}
