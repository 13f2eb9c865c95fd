"""BVH files as programs write them: one walk in each kind of unit, axes and rest pose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from latentmotion.formats.bvh import BvhLayout, write_bvh
from latentmotion.formats.engines import for_engine
from latentmotion.kinematics.skeleton import Animation, Skeleton, posed
from latentmotion.kinematics.standing import AXES, METERS_PER_UNIT, in_axes, rebased
from latentmotion.motion import Motion
from tests.support.walker import walker

FINGER = 0.08


def walk(frames: int = 30) -> Motion:
    """Returns the walk that all files show."""
    joints = walker(frames).joints()
    joints[..., 1] -= joints[..., 1].min() - 0.01
    return Motion(joints.astype("f4"), 20.0)


def with_fingers(frames: int = 30) -> Animation:
    """Returns the walk on a skeleton of Mixamo's names whose head, hands and fingers turn."""
    motion = for_engine(walk(frames), "lafan").animation()
    names = [name.replace("Toe", "ToeBase") for name in motion.skeleton.names]
    parents, offsets = list(motion.skeleton.parents), np.asarray(motion.skeleton.offsets).tolist()
    for side in ("Left", "Right"):
        for number in (1, 2, 3):
            parent = f"{side}Hand" if number == 1 else f"{side}HandIndex{number - 1}"
            parents.append(names.index(parent))
            names.append(f"{side}HandIndex{number}")
            offsets.append([FINGER, 0, 0])
    skeleton = Skeleton("mixamo", tuple(names), tuple(parents), np.array(offsets))
    rotations = np.tile(np.eye(3), (len(motion), len(names), 1, 1))
    rotations[:, : len(motion.skeleton)] = motion.rotations
    share = np.linspace(0, 1, len(motion))
    for name, degrees in (("Head", 70), ("LeftForeArm", 60), ("LeftHandIndex2", 80)):
        angle = np.radians(degrees) * share
        turn = np.tile(np.eye(3), (len(motion), 1, 1))
        first, second = (0, 1) if "Index" in name else (1, 2)
        turn[:, first, first] = turn[:, second, second] = np.cos(angle)
        turn[:, second, first], turn[:, first, second] = np.sin(angle), -np.sin(angle)
        joint = names.index(name)
        rotations[:, joint] = rotations[:, joint] @ turn
    return Animation(skeleton, rotations, motion.root_positions, motion.fps)


def _written(path: Path, animation: Animation, up: str = "y", unit: str = "centimeters") -> Path:
    axes = AXES[up].T
    write_bvh(path, in_axes(animation, axes, 1.0), BvhLayout("ZYX", METERS_PER_UNIT[unit]))
    return path


def _standing(frames: int) -> Animation:
    return walk(frames).animation()


def _turned_root(frames: int) -> Animation:
    """Returns frames with z up of a skeleton whose rest pose has y up, as bodies of SMPL become."""
    animation, turn = _standing(frames), AXES["z"]
    rotations = animation.rotations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    return replace(animation, rotations=rotations, root_positions=animation.root_positions @ turn.T)


def _backward(frames: int) -> Animation:
    """Returns frames of a skeleton whose rest pose faces -z."""
    animation = _standing(frames)
    return rebased(animation, np.tile(np.diag([-1.0, 1, -1]), (len(animation.skeleton), 1, 1)))


def _heap(frames: int) -> Animation:
    """Returns frames of a skeleton whose offsets are all 0: channels have them."""
    animation = _standing(frames)
    skeleton = replace(animation.skeleton, offsets=np.zeros((len(animation.skeleton), 3)))
    world = animation.skeleton.world_rotations(animation.rotations)
    return posed(skeleton, world, animation.joints(), animation.fps)


# Writers of files, each of one kind; the walk in them is `walk()`, in its own place.
KINDS: Mapping[str, Callable[[Path], Path]] = MappingProxyType(
    {
        **{
            f"{unit}, {up} up": lambda path, unit=unit, up=up: _written(
                path, _standing(30), up, unit
            )
            for unit, up in (
                *((unit, "y") for unit in METERS_PER_UNIT),
                *(("centimeters", up) for up in AXES if up != "y"),
                *(("meters", "z"), ("millimeters", "z"), ("cmu", "-y")),
            )
        },
        "facing backward at rest": lambda path: _written(path, _backward(30)),
        "z up, rest pose with y up": lambda path: _written(path, _turned_root(30)),
        "bones along one axis": lambda path: _written(path, with_fingers()),
        "bones along one axis, z up, inches": lambda path: _written(
            path, with_fingers(), "z", "inches"
        ),
        "bones in a heap": lambda path: _written(path, _heap(30)),
        "bones in a heap, meters": lambda path: _written(path, _heap(30), unit="meters"),
        "of LAFAN1": lambda path: for_engine(walk(), "lafan").save(path)[0],
        "of CMU": lambda path: for_engine(walk(), "cmu").save(path)[0],
    }
)
