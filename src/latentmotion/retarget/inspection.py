"""Inspection of characters: their bones, and the bones that correspond to our joints."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from latentmotion.errors import DataError
from latentmotion.kinematics.bone_names import OPTIONAL, REQUIRED
from latentmotion.kinematics.draft import draft_map
from latentmotion.kinematics.humanoid import find_humanoid
from latentmotion.retarget.rig import make_rig
from latentmotion.retarget.rig_files import RigFile, open_rig


@dataclass(frozen=True)
class RigReport:
    """Description of a character."""

    bones: tuple[str, ...]
    """Names of its bones."""
    mapping: dict[str, str | None]
    """Our joints → its bones."""
    guessed: tuple[str, ...] = ()
    """Joints whose bones were guessed; people should look at them."""
    missing: tuple[str, ...] = ()
    """Joints that are needed and have no bone."""
    problem: str | None = None
    """Why no motion can be put on it yet."""


def inspect_rig(path: str | Path, joint_map: Mapping[str, str] | None = None) -> RigReport:
    """Reads a character and finds its joints by their names; where that fails, they are guessed.

    Args:
        path: The file.
        joint_map: Our joints → its bones; by default found.

    Raises:
        FileFormatError: The file is damaged.
        DataError: The map names joints that are not there.
        InputError: There is no such file, or of no such kind.
    """
    file, guessed = open_rig(path), ()
    bones = file.skeleton.names
    if joint_map is None:
        joint_map, guessed = _bones_of_joints(file)
    mapping = {name: joint_map.get(name) for name in (*REQUIRED, *OPTIONAL)} | dict(joint_map)
    missing = tuple(name for name in REQUIRED if mapping[name] is None)
    problem = f"no bone is named for {', '.join(missing)}" if missing else None
    try:
        make_rig(file, find_humanoid(file.skeleton, joint_map=joint_map))
    except DataError as error:
        unknown = [bone for bone in joint_map.values() if bone not in bones]
        if unknown or set(joint_map) - {*REQUIRED, *OPTIONAL}:
            raise
        problem = problem or str(error)
    return RigReport(bones, mapping, guessed, missing, problem)


def _bones_of_joints(file: RigFile) -> tuple[dict[str, str], tuple[str, ...]]:
    """Returns the bones of our joints in a character, and the joints that are guesses."""
    names = file.skeleton.names
    try:
        joints = find_humanoid(file.skeleton, file.declared).joints
        return {ours: names[joint] for ours, joint in joints.items()}, ()
    except DataError:
        guesses = {}
        with suppress(DataError):  # it has no legs
            guesses = draft_map(file.skeleton)
        return {ours: names[guess.joint] for ours, guess in guesses.items()}, tuple(guesses)
