"""Humanoids: the joints of a foreign skeleton by our names; positions of HumanML3D's 22 from them.

A joint map, which a user writes for a rig with unknown names, says which joint is which of ours.
Names are looked up in `bone_names.py`; the tree gives pelvis, chest, spine and neck.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import DataError, FileFormatError
from latentmotion.kinematics import bone_names as naming
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton
from latentmotion.storage.reading import read_json_file

_LIMBS = (("hip", "knee", "ankle", "foot"), ("shoulder", "elbow", "wrist"))

_HOW_TO_MAP = (
    "draft a joint map with `latentmotion retarget --to FILE --draft-map map.json`, correct it, "
    "pass it with --map map.json"
)

# Lengths of a shank, in thighs, up to which a foot that hangs elsewhere is taken for its end.
_FREE = (0.4, 2.5)


@dataclass(frozen=True, eq=False)
class Humanoid:
    """A skeleton whose joints are known by the names of ours.

    Raises:
        DataError: Joints are missing, or do not hang on each other as a body's do.
    """

    skeleton: Skeleton  # The skeleton with these joints.
    joints: Mapping[str, int]  # Our name → the joint's index.
    names: str = "a map"  # Naming convention, for messages.

    def __post_init__(self) -> None:
        names = self.skeleton.names
        missing = [name for name in naming.REQUIRED if name not in self.joints]
        if missing:
            mapped = set(self.joints.values())
            free = [name for joint, name in enumerate(names) if joint not in mapped]
            raise DataError(
                f"found no {', '.join(missing)} in the rig (names of {self.names}); of its joints "
                "without a part these come nearest: "
                f"{naming.nearest(free, naming.names_of(missing, self.names))}; {_HOW_TO_MAP}"
            )
        for side, limb in product(naming.SIDES, _LIMBS):
            chain = [f"{side}_{joint}" for joint in limb if f"{side}_{joint}" in self.joints]
            for upper, lower in pairwise(chain):
                a, b = self.joints[upper], self.joints[lower]
                if (a == b or a not in self.lines[b]) and lower not in self.free_feet:
                    raise DataError(
                        f"{lower} ({names[b]!r}) does not hang on {upper} ({names[a]!r}); "
                        "correct the map of joints"
                    )

    @property
    def lines(self) -> tuple[tuple[int, ...], ...]:
        """For each joint of the skeleton itself, its parent and so on up to the root."""
        return self.skeleton.lines

    @cached_property
    def rehung(self) -> dict[int, int]:
        """Joints that hang elsewhere than bodies' do, and the joint that moves them in a body.

        IK moves feet that hang on no shank; Rigify's arms hang on no chest.
        """
        movers = {
            self.joints[ankle]: self.joints[ankle.replace("ankle", "knee")]
            for ankle in self.free_feet
        }
        chains = [[f"{side}_collar", f"{side}_shoulder"] for side in naming.SIDES] + [
            ["neck", "head"]
        ]
        for chain in chains:
            above = self.chest
            for joint in (self.joints[name] for name in chain if name in self.joints):
                if above not in self.lines[joint] and joint not in self.lines[above]:
                    movers[joint] = above
                above = joint
        return movers

    @cached_property
    def free_feet(self) -> tuple[str, ...]:
        """Ankles that hang elsewhere than on their shank, as feet that IK moves do."""
        free, rest = [], self.skeleton.rest_joints()
        hips = {self.joints[f"{side}_hip"] for side in naming.SIDES}
        for side in naming.SIDES:
            hip, knee, ankle = (self.joints[f"{side}_{name}"] for name in _LIMBS[0][:3])
            thigh, shank = (
                float(np.linalg.norm(rest[b] - rest[a])) for a, b in ((hip, knee), (knee, ankle))
            )
            apart = ankle not in self.lines[knee] and not hips & set(self.lines[ankle])
            if apart and _FREE[0] * thigh < shank < _FREE[1] * thigh:
                free.append(f"{side}_ankle")
        return tuple(free)

    @cached_property
    def pelvis(self) -> int:
        """The joint that carries legs and spine, and moves the whole."""
        carried = [*(self.joints[f"{side}_hip"] for side in naming.SIDES), self.chest]
        named = self.joints.get("pelvis")
        # Rigify's deforming pelvis does not carry its deforming thighs, others' no spine.
        if named is not None and all(named in self.lines[joint] for joint in carried):
            return named
        return self._common_ancestor(carried)

    @cached_property
    def chest(self) -> int:
        """The joint that carries arms and neck."""
        tops = [f"{side}_shoulder" for side in naming.SIDES] + [
            "neck" if "neck" in self.joints else "head"
        ]
        joints = [self.joints[top] for top in tops if top in self.joints]
        shared = self._common_ancestor([max(self.skeleton.parents[joint], 0) for joint in joints])
        hips = {joint for side in naming.SIDES for joint in self.lines[self.joints[f"{side}_hip"]]}
        if shared not in hips:
            return shared
        # Where arms hang on what carries the legs too: of the spine, what is nearest to them.
        spine = {above for joint in joints for above in self.lines[joint][1:]} - hips
        spine -= {self.joints.get(name) for name in ("neck", "left_collar", "right_collar")}
        rest = self.skeleton.rest_joints()
        middle = np.mean([rest[self.joints[f"{side}_shoulder"]] for side in naming.SIDES], axis=0)
        distances = {joint: float(np.linalg.norm(rest[joint] - middle)) for joint in spine}
        return min(distances, key=distances.__getitem__, default=shared)

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

    def joint_map(self) -> dict[str, str | Mapping[str, float]]:
        """Returns the map that reads positions of our 22 joints from this skeleton.

        Where a rig lacks a joint, the point lies where ours do between its neighbors.
        """
        names = self.skeleton.names
        sources: dict[str, str | Mapping[str, float]] = {
            name: names[joint] for name, joint in self.joints.items()
        }
        spine = [names[joint] for joint in (self.pelvis, *self.spine)]
        sources["pelvis"] = spine[0]
        for number in (1, 2, 3):
            position = number / 3 * (len(spine) - 1)
            below, share = spine[int(position)], position - int(position)
            above = spine[min(int(position) + 1, len(spine) - 1)]
            mixed = (
                # Near a joint of the rig, that joint alone: a map that names one joint is easier to
                # correct.
                {below: 1 - share, above: share} if 0.01 < share < 0.99 else spine[round(position)]
            )
            sources.setdefault(f"spine{number}", mixed)
        chest = names[self.chest]
        if self.neck:
            sources.setdefault("neck", names[self.neck[0]])
        elif "head" in self.joints:
            # Between chest and head, nearer to the head.
            sources.setdefault("neck", {chest: 0.35, names[self.joints["head"]]: 0.65})
        neck = sources.setdefault("neck", chest)
        stretched = {neck: 1.5, chest: -0.5} if isinstance(neck, str) and neck != chest else neck
        sources.setdefault("head", stretched)
        # Horizontal direction that the body faces in the rest pose, from hips and height.
        rest = self.skeleton.rest_joints()
        left, right, foot = (rest[self.joints[n]] for n in ("left_hip", "right_hip", "left_ankle"))
        ahead = np.cross(left - right, rest[self.chest] - foot)
        for side in naming.SIDES:
            shoulder, ankle = (self.joints[f"{side}_{name}"] for name in ("shoulder", "ankle"))
            sources.setdefault(f"{side}_collar", {names[shoulder]: 0.45, chest: 0.55})
            below = self.skeleton.children(ankle)
            toes = max(below, key=lambda tip: self.skeleton.offsets[tip].dot(ahead), default=0)
            sources.setdefault(f"{side}_foot", names[toes or ankle])
        return sources

    def _common_ancestor(self, joints: list[int]) -> int:
        """Returns the lowest joint that all these equal or descend from."""
        shared = set(self.lines[joints[0]]).intersection(*(self.lines[joint] for joint in joints))
        return max(shared, key=lambda joint: len(self.lines[joint]))

    def _between(self, above: int, joint: int) -> tuple[int, ...]:
        line = self.lines[joint]
        return line[: line.index(above)][::-1] if above in line else ()


def find_humanoid(
    skeleton: Skeleton,
    declared: Mapping[str, int] | None = None,
    joint_map: naming.JointMap | None = None,
) -> Humanoid:
    """Finds our joints in a skeleton: by a map, by what its file declares, else by its names.

    Args:
        skeleton: Any skeleton.
        declared: VRM's names of its joints, where the file itself has them.
        joint_map: Our joints → the skeleton's; entries that begin with `_` are remarks.

    Raises:
        DataError: The names are unknown, or a joint is missing; the message says which. Or the map
            names joints that are not there.
    """
    if joint_map is not None:
        return _mapped(skeleton, joint_map)
    if declared:
        bones = {naming.plain(name): joint for name, joint in declared.items()}
        joints = {
            ours: bones[name[0]]
            for ours, name in naming.name_maps()["VRM"].items()
            if name[0] in bones
        }
        return Humanoid(skeleton, _with_ends(skeleton, joints), "VRM")
    match = naming.match_names(skeleton.names)
    if match.missing and (added := naming.find_joint_map(skeleton.names)):
        return _mapped(skeleton, added)
    if len(match.missing) > len(naming.REQUIRED) // 2:
        raise DataError(
            f"unknown names of joints; of the {len(skeleton)} found these look most like limbs: "
            f"{naming.nearest(skeleton.names)}; {_HOW_TO_MAP}"
        )
    return Humanoid(skeleton, _with_ends(skeleton, match.joints), match.convention)


def _with_ends(skeleton: Skeleton, joints: Mapping[str, int]) -> Mapping[str, int]:
    """Returns joints with wrists and ankles of other names: where forearm and shank end."""
    ends = dict(joints)
    for side, (upper, end) in product(naming.SIDES, (("elbow", "wrist"), ("knee", "ankle"))):
        below = skeleton.children(joints.get(f"{side}_{upper}", -1))
        if f"{side}_{end}" not in joints and f"{side}_{upper}" in joints and below:
            lengths = np.linalg.norm(np.asarray(skeleton.offsets)[list(below)], axis=-1)
            ends[f"{side}_{end}"] = below[int(lengths.argmax())]
    return ends


def _mapped(skeleton: Skeleton, joint_map: naming.JointMap) -> Humanoid:
    """Returns the joints that a map names."""
    index = _columns(skeleton.names)
    joints = {}
    for name, source in _entries(joint_map).items():
        weights = naming.weights_of(source)
        main = max(weights, key=weights.__getitem__)
        joints[name] = _column(index, skeleton.names, name, main)
    return Humanoid(skeleton, joints)


def _entries(joint_map: naming.JointMap) -> dict[str, str | Mapping[str, float]]:
    """Returns the map without comments (keys that begin with an underscore), checked."""
    entries = {name: source for name, source in joint_map.items() if not name.startswith("_")}
    parts = (*naming.REQUIRED, *naming.OPTIONAL)
    for name in entries:
        if name not in parts:
            raise DataError(
                f"the joint map has {name!r}, which is none of our joints; nearest are "
                f"{naming.nearest(parts, [name], 3)}"
            )
    return entries


def _columns(names: Sequence[str]) -> dict[str, int]:
    """Returns indices by name, with and without namespace; the first of equal names counts."""
    numbered = list(enumerate(names))[::-1]
    columns = {naming.without_namespace(name): column for column, name in numbered}
    return columns | {name: column for column, name in numbered}


def _column(columns: Mapping[str, int], names: Sequence[str], ours: str, source: str) -> int:
    column = columns.get(source, columns.get(naming.without_namespace(source)))
    if column is None:
        raise DataError(
            f"the joint map says {ours!r} is {source!r}, which is none of the skeleton's "
            f"{len(names)} joints; nearest are {naming.nearest(names, [source])}"
        )
    return column


def to_humanml3d(
    animation: Animation,
    joint_map: naming.JointMap | None = None,
    declared: Mapping[str, int] | None = None,
) -> Float[np.ndarray, "frames 22 3"]:
    """Returns the positions of HumanML3D's 22 joints in an animation of another skeleton.

    Positions stay where they are: neither bone lengths, floor nor facing change.

    Args:
        animation: Any body, y up, in meters.
        joint_map: The source of each of the 22, or at least of `REQUIRED`; by default, and where
            none of its joints are there, found by the names.
        declared: VRM's names of its joints, where the file itself has them.

    Raises:
        DataError: The skeleton is unknown, or the map names joints that are not there.
    """
    skeleton, columns = animation.skeleton, _columns(animation.skeleton.names)
    entries = {} if joint_map is None else _entries(joint_map)
    sources = {source for entry in entries.values() for source in naming.weights_of(entry)}
    if not any(source in columns for source in sources):  # none, or of another skeleton
        joint_map = None if declared else naming.find_joint_map(skeleton.names)
        entries = dict(joint_map or {})
    if len(entries) < len(HUMANML3D):
        entries = find_humanoid(skeleton, declared, joint_map).joint_map() | entries
    weights = np.zeros((len(HUMANML3D), len(skeleton)))
    for row, name in enumerate(HUMANML3D.names):
        for source, weight in naming.weights_of(entries[name]).items():
            weights[row, _column(columns, skeleton.names, name, source)] += weight
    return np.einsum("hj,fjc->fhc", weights, animation.joints(), optimize=True)


# Words for fingers in the names of bones.
_FINGERS = {"thumb": "thumb", "index": "index", "middle": "middle", "ring": "ring"} | dict.fromkeys(
    ("pinky", "little"), "little"
)


def fingers_below(body: Humanoid, wrist: str) -> dict[str, list[int]]:
    """Returns the bones of each finger below a wrist by its name, outward, without tips.

    Bones of the palm, and an exporter's end bones, are left out: programs differ in these.
    """
    skeleton, fingers = body.skeleton, {}
    carriers = set(skeleton.parents)
    for joint, name in enumerate(skeleton.names):
        word = next((word for word in _FINGERS if word in name.lower()), None)
        palm = "metacarpal" in name.lower() or "palm" in name.lower()
        tip = joint in skeleton.end_sites or joint not in carriers
        if word and not palm and not tip and body.joints[wrist] in body.lines[joint][1:]:
            fingers.setdefault(_FINGERS[word], []).append(joint)
    return fingers


def fitting_map(
    joint_maps: Iterable[naming.JointMap], names: Sequence[str]
) -> naming.JointMap | None:
    """Returns the first of some joint maps of which a skeleton has a joint, if any."""
    columns = set(_columns(names))
    for joint_map in joint_maps:
        sources = (
            source for entry in _entries(joint_map).values() for source in naming.weights_of(entry)
        )
        if any(
            source in columns or naming.without_namespace(source) in columns for source in sources
        ):
            return joint_map
    return None


def load_joint_map(path: str | Path) -> naming.JointMap:
    """Reads a joint map from a JSON file such as `{"pelvis": "Hips", "spine1": "Spine", …}`.

    Raises:
        FileFormatError: The file cannot be read or holds something else.
    """
    joint_map = read_json_file(path)
    if not naming.is_joint_map(joint_map):
        raise FileFormatError(
            path,
            'expected an object such as {"pelvis": "Hips", …}; a value is the name of a joint, '
            "or an object of weights that sum to 1",
        )
    return joint_map
