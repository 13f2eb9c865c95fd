"""Names of bones: which joints of a foreign skeleton are ours, by what programs call them.

One table for all readers. A naming convention lists the names of each of our joints as `plain`
writes them, the likeliest first; whole rigs may put anything before and behind (`Bob_`, `CC_Base_`,
`_jnt`). Names must match whole, so that twist, roll, IK and helper bones are never taken for limbs.
Spines need no names: they are all joints between pelvis and chest.

Skeletons of the data sets also have joint maps, which say where positions are read. Each of the 22
is one source joint, or a weighted mean of several where the source has no such point (Acclaim's
clavicles start at the spine, SMPL's in front of the shoulder). The weights put the point where
SMPL's rest pose has it between its neighbors.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from types import MappingProxyType

from latentmotion.errors import DataError
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.plugins import plugins, warn_of

JointMap = Mapping[str, str | Mapping[str, float]]
"""HumanML3D's name → a source joint, or the weights of several that sum to 1."""

_NAMESPACE = re.compile(r"^(.*:)?(mixamorig\d*_?)?", re.IGNORECASE)


def weights_of(source: str | Mapping[str, float]) -> Mapping[str, float]:
    """Returns the weights of an entry of a joint map."""
    return {source: 1.0} if isinstance(source, str) else source


def _symmetric(middle: JointMap, side: JointMap, left: str, right: str) -> JointMap:
    """Completes a map: `@` in the source names of `side` stands for the prefix of either side."""
    joints = dict(middle)
    for name, prefix in (("left", left), ("right", right)):
        for joint, source in side.items():
            weights = weights_of(source).items()
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
"""Joint maps, tried in turn: the first whose source joints are all there is taken."""


def without_namespace(name: str) -> str:
    """Returns the name without a namespace (`Bob:`) and without `mixamorig`."""
    return _NAMESPACE.sub("", name, count=1) or name


def find_joint_map(names: Sequence[str]) -> JointMap | None:
    """Returns the first map whose source joints are all among `names`, if any.

    Plugins' maps follow `JOINT_MAPS`, for names that no convention explains.
    """
    plain_names = {without_namespace(name) for name in names}

    def fits(joint_map: JointMap) -> bool:
        sources = (source for entry in joint_map.values() for source in weights_of(entry))
        return plain_names.issuperset(map(without_namespace, sources))

    fitting = next(filter(fits, JOINT_MAPS.values()), None)
    if fitting is None and match_names(names).missing:
        fitting = next(filter(fits, added_joint_maps().values()), None)
    return fitting


def added_joint_maps() -> dict[str, JointMap]:
    """Returns the joint maps of the plugins of `latentmotion.skeletons` by name."""
    joint_maps = plugins("latentmotion.skeletons")
    for name in list(joint_maps):
        if not is_joint_map(joint_maps[name]) or set(joint_maps[name]) != set(HUMANML3D.names):
            error = DataError(f"expected a joint map of {', '.join(HUMANML3D.names)}")
            warn_of("latentmotion.skeletons", name, error)
            del joint_maps[name]
    return joint_maps


def is_joint_map(value: object) -> bool:
    """Returns whether a value maps names to names, or to weights that sum to 1."""
    valid = isinstance(value, Mapping)
    for source in value.values() if isinstance(value, Mapping) else ():
        weights = source.values() if isinstance(source, Mapping) else ()
        numeric = all(isinstance(weight, int | float) for weight in weights)
        valid &= isinstance(source, str) or (numeric and abs(sum(weights) - 1) < 1e-6)
    return valid


NameMap = Mapping[str, tuple[str, ...]]
"""One of our joints → the names it may have, `plain`, the likeliest first."""

SIDES = ("left", "right")

LIMB_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
"""Joints that every rig must have on both sides."""

REQUIRED = tuple(f"{side}_{joint}" for side in SIDES for joint in LIMB_JOINTS)
"""Joints without which a skeleton is no body."""

OPTIONAL = (
    *("pelvis", "neck", "head", "left_collar", "right_collar", "left_foot", "right_foot"),
    *("spine1", "spine2", "spine3"),
)
"""Joints that are derived from the others, or stay at rest, if a rig lacks them."""

_PREFIX = re.compile(
    r"^(.*[:|])?(mixamorig\d*[_:]?)?(?P<kind>def|org)?(?(kind)[-_])", re.IGNORECASE
)
_NUMBER = re.compile(r"[_.]\d+$")


def plain(name: str) -> str:
    """Returns a name without namespace, `mixamorig`, `DEF-`, punctuation and capitals."""
    return re.sub(r"[\W_]", "", _PREFIX.sub("", name, count=1).lower())


_SIDE_PARTS = ("hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist")


def _convention(marks: str, middle: str, side: str) -> NameMap:
    """Returns a convention.

    Args:
        marks: Marks of the left and the right side in names, separated by `/`.
        middle: Names of pelvis, neck and head; `/` parts names that a joint may have.
        side: Names of hip, knee, ankle, toes, collar, shoulder, elbow and wrist; `@` is the mark.
    """
    pairs = zip(("pelvis", "neck", "head"), middle.split(), strict=True)
    names = {joint: tuple(words.split("/")) for joint, words in pairs}
    for whole, mark in zip(SIDES, marks.split("/"), strict=True):
        for joint, words in zip(_SIDE_PARTS, side.split(), strict=True):
            names[f"{whole}_{joint}"] = tuple(words.replace("@", mark).split("/"))
    return names


def _of_joint_map(name: str) -> NameMap:
    """Returns the joints of a joint map that have a single or a main source."""
    return {
        joint: (plain(max(weights_of(source).items(), key=lambda item: item[1])[0]),)
        for joint, source in JOINT_MAPS[name].items()
        if joint.partition("_")[0] in SIDES or joint in ("neck", "head")
    }


_WORDS, _LETTERS = "left/right", "l/r"
_MIDDLE = "hips/pelvis/hip neck head"

VRM = _convention(
    *(_WORDS, _MIDDLE),
    "@upperleg @lowerleg @foot @toes/@toe/@toebase @shoulder @upperarm @lowerarm @hand",
)
"""The bones of VRM's humanoid, which are Unity's too."""

_JOINTS = "@hip @knee @ankle @foot/@toe/@toes/@toebase @collar @shoulder @elbow @wrist"
_MIXAMO = "@upleg @leg @foot @toebase/@toe/@toes @shoulder @arm @forearm @hand"
_JOINTS_BEHIND = (
    "hip@ knee@ ankle@ foot@/toes@/toe@ clavicle@/scapula@/collar@ shoulder@ elbow@ wrist@"
)
_BEHIND = (
    "upperleg@ lowerleg@ foot@ toe@/toes@/toebase@ shoulder@/clavicle@ upperarm@ "
    "lowerarm@/forearm@ hand@/palm@/palm2@/palm1@/fist@/wrist@"
)

NAME_MAPS: Mapping[str, NameMap] = MappingProxyType(
    {
        "Latent Motion": {name: (plain(name),) for name in HUMANML3D.names},
        "Mixamo": _convention(_WORDS, _MIDDLE, _MIXAMO),
        "Unreal": _convention(
            *(_LETTERS, "pelvis neck01 head"),
            "thigh@ calf@ foot@ ball@ clavicle@ upperarm@ lowerarm@ hand@",
        ),
        "VRM": VRM,
        "VRoid": _convention(
            *(_LETTERS, "jbipchips jbipcneck jbipchead"),
            "jbip@upperleg jbip@lowerleg jbip@foot jbip@toebase jbip@shoulder jbip@upperarm "
            "jbip@lowerarm jbip@hand",
        ),
        "Rigify": _convention(
            *(_LETTERS, "spine/hips spine004/neck spine006/head"),
            "thigh@ shin@ foot@ toe@ shoulder@ upperarm@ forearm@ hand@",
        ),
        "Daz Genesis": _convention(
            *(_LETTERS, "hip necklower/neck1/neck head"),
            "@thighbend/@thigh @shin @foot @toe/@toes @collar/@shoulder "
            "@shldrbend/@shldr/@upperarm @forearmbend/@forearm @hand",
        ),
        "Daz BVH": _of_joint_map("daz"),
        "Acclaim": _of_joint_map("acclaim"),
        "SMPL": _convention(_LETTERS, _MIDDLE, _JOINTS),
        "Character Creator": _convention(
            *(_LETTERS, "ccbasehip ccbasenecktwist01 ccbasehead"),
            "ccbase@thigh ccbase@calf ccbase@foot ccbase@toebase ccbase@clavicle "
            "ccbase@upperarm ccbase@forearm ccbase@hand",
        ),
        "Biped": _convention(
            *(_LETTERS, "pelvis neck head"),
            "@thigh @calf @foot @toe0/@toe/@toebase @clavicle @upperarm @forearm @hand",
        ),
        "Xsens MVN": _convention(
            *(_WORDS, "pelvis/hips neck head"),
            "@upperleg @lowerleg @foot @toe @shoulder @upperarm @forearm @hand",
        ),
        "Xsens BVH": _convention(_WORDS, "hips neck head", _JOINTS),
        "Rokoko": _convention(
            *(_WORDS, "hips neck head"),
            "@thigh @shin @foot @toe @shoulder @arm @forearm @hand",
        ),
        "OptiTrack": _convention(
            *(_LETTERS, "hip/hips neck head"),
            "@thigh @shin @foot @toe @shoulder @uarm @farm @hand",
        ),
        "ARKit": _convention(
            *(_WORDS, "hipsjoint neck1joint headjoint"),
            "@uplegjoint @legjoint @footjoint @toesjoint @shoulder1joint @armjoint "
            "@forearmjoint @handjoint",
        ),
        "Blender .L": _convention(_LETTERS, "hips/pelvis/body neck head", _BEHIND),
        "Blender .Left": _convention(_WORDS, "hips/pelvis/body neck head", _BEHIND),
        "VRM with L and R": _convention(
            *(_LETTERS, _MIDDLE),
            "@upperleg @lowerleg @foot @toes/@toe/@toebase @shoulder/@clavicle @upperarm "
            "@lowerarm/@forearm @hand",
        ),
        "Mixamo with L and R": _convention(_LETTERS, _MIDDLE, _MIXAMO),
        "Azure Kinect": _convention(_WORDS, "pelvis neck head", _JOINTS_BEHIND),
        "Advanced Skeleton": _convention(
            _LETTERS, "rootm/pelvis neckm/neck headm/head", _JOINTS_BEHIND
        ),
        "MikuMikuDance": _convention(
            *("左/右", "下半身/腰/センター 首 頭"),
            "@足 @ひざ @足首 @つま先/@足先ex @肩 @腕 @ひじ @手首",
        ),
        "MakeHuman": _convention(
            *(_LETTERS, "root neck01 head"),
            "upperleg01@ lowerleg01@ foot@ toe11@ clavicle@ upperarm01@ lowerarm01@ wrist@",
        ),
    }
)
"""Known naming conventions, tried in this order. MotionBuilder's and others' are Mixamo's."""


@dataclass(frozen=True)
class NameMatch:
    """The joints that a convention finds in a skeleton."""

    convention: str
    """Name of the convention, a key of `NAME_MAPS`."""
    joints: Mapping[str, int]
    """Our joints that were found, and their indices."""

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
            name = _NUMBER.sub("", names[number]) if unnumbered else names[number]
            index[plain(name)] = number
    matches = [NameMatch(name, _matched(index, words)) for name, words in NAME_MAPS.items()]
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


_PARTS = (
    *("thigh", "upleg", "upperleg", "hip", "calf", "shin", "knee", "lowerleg", "foot", "ankle"),
    *("upperarm", "shoulder", "forearm", "lowerarm", "elbow", "hand", "wrist"),
)
"""Words for limbs in most conventions."""


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
    words = NAME_MAPS.get(convention, {})
    return [word for joint in joints for word in words.get(joint, (joint,))]
