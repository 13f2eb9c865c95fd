"""Figures for game engines: the engine's names of bones, and a root bone on the floor.

The root bone carries root motion, the path along the floor without the sway of the steps; the
pelvis moves relative to it. Axes and unit are the format's; engines convert them on import.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from latentmotion.cleanup.pipeline import ground_path
from latentmotion.errors import InputError
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton
from latentmotion.motion import Motion
from latentmotion.render.mannequin import Mannequin, make_mannequin

EngineName = Literal["unreal", "unity"]

ENDINGS = (".glb", ".gltf", ".fbx", ".bvh")
"""Files that hold figures with an engine's names."""


@dataclass(frozen=True)
class Engine:
    """Conventions of a game engine for figures."""

    root: str
    """Name of the root bone."""
    names: Mapping[str, str]
    """HumanML3D's joint → the bone."""
    fps: float
    """Usual frames per second of animations."""


def _engine(root: str, middle: str, side: str, marks: tuple[str, str]) -> Engine:
    parts = ["pelvis", "spine1", "spine2", "spine3", "neck", "head"]
    names = dict(zip(parts, middle.split(), strict=True))
    limbs = ["hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist"]
    for whole, mark in zip(SIDES, marks, strict=True):
        words = side.replace("@", mark).split()
        names |= {f"{whole}_{limb}": word for limb, word in zip(limbs, words, strict=True)}
    return Engine(root, names, 30.0)


ENGINES: Mapping[EngineName, Engine] = MappingProxyType(
    {
        "unreal": _engine(
            "root",
            "pelvis spine_01 spine_02 spine_03 neck_01 head",
            "thigh_@ calf_@ foot_@ ball_@ clavicle_@ upperarm_@ lowerarm_@ hand_@",
            ("l", "r"),
        ),
        "unity": _engine(
            "Root",
            "Hips Spine Chest UpperChest Neck Head",
            "@UpperLeg @LowerLeg @Foot @Toes @Shoulder @UpperArm @LowerArm @Hand",
            ("Left", "Right"),
        ),
    }
)
"""Engines, by the names of their mannequin's or humanoid's bones."""


def for_engine(motion: Motion, name: EngineName) -> Motion:
    """Returns a motion of the same body with an engine's bones and root motion on its root bone.

    Raises:
        InputError: The motion is of other joints than HumanML3D's.
    """
    engine, animation = ENGINES[name], motion.animation()
    old = animation.skeleton
    if old.names != HUMANML3D.names:
        raise InputError(
            f"bones of {name} are known for HumanML3D's 22 joints, not for {old.name!r}"
        )
    height = -old.rest_joints()[:, 1].min()
    skeleton = Skeleton(
        name=name,
        names=(engine.root, *(engine.names[joint] for joint in old.names)),
        parents=(-1, *(parent + 1 for parent in old.parents)),
        offsets=np.concatenate([[(0, 0, 0), (0, height, 0)], old.offsets[1:]]),
        left_foot=tuple(joint + 1 for joint in old.left_foot),
        right_foot=tuple(joint + 1 for joint in old.right_foot),
    )
    path = ground_path(animation.root_positions[:, None], motion.fps)
    translations = np.tile(skeleton.offsets, (len(motion), 1, 1))
    if animation.translations is not None:
        translations[:, 2:] = animation.translations[:, 1:]
    translations[:, 1] = animation.root_positions - path
    still = np.tile(np.eye(3), (len(motion), 1, 1, 1))
    rotations = np.concatenate([still, animation.rotations], axis=1)
    rooted = Animation(skeleton, rotations, path, motion.fps, translations)
    figure = replace(motion, joints=rooted.joints().astype(np.float32), skeleton=skeleton, goals=())
    # Its rotations are known, so writers need not solve for them again.
    figure.__dict__["_solved"] = rooted
    return figure


def mannequin_of(skeleton: Skeleton) -> Mannequin:
    """Returns the mannequin of a skeleton, also of one with an engine's bones."""
    if skeleton.name not in ENGINES or len(skeleton) != len(HUMANML3D) + 1:
        return make_mannequin(skeleton)
    offsets = np.concatenate([np.zeros((1, 3)), skeleton.offsets[2:]])
    body = make_mannequin(replace(HUMANML3D, offsets=offsets))
    vertices = body.vertices + skeleton.offsets[1]
    return replace(body, vertices=vertices, joints=body.joints + 1, skeleton=skeleton)
