"""Takes: motions from the animations of any program's files."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from latentmotion.errors import FileFormatError, ReadingWarning
from latentmotion.formats import asf_amc, bvh
from latentmotion.kinematics import bone_names, humanoid, keypoints, standing
from latentmotion.kinematics.recorded import Recorded
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, KIT, Animation
from latentmotion.motion import Motion
from latentmotion.storage.reading import parse_json

# Our own skeletons by the names of their joints.
OURS = {skeleton.names: skeleton for skeleton in (HUMANML3D, KIT, BODY)}


@dataclass(frozen=True, eq=False)
class SkeletonTake:
    """One animation of a file, in the file's own unit and axes."""

    animation: Animation  # Of the file's skeleton.
    # The file's `caption` and other metadata.
    notes: Mapping[str, Any] = field(default_factory=dict)
    # VRM's names of its joints, where the file itself has them.
    declared: Mapping[str, int] = field(default_factory=dict)
    # Meters per unit as the format or the file says; None where neither does.
    meters: float | None = 1.0
    # Whether a tracker made it of a video: its rate is a guess, its axes may be the camera's.
    from_video: bool = False
    path_is_missing: bool = False  # Whether the body stays in place although it moved.


def read_bvh_file(path: str | Path) -> list[SkeletonTake]:
    """Reads a BVH file, which does not say in which unit it is.

    Raises:
        FileFormatError: The file is damaged.
    """
    return [SkeletonTake(bvh.read_bvh(path, 1.0), meters=None)]


def read_amc_file(path: str | Path) -> list[SkeletonTake]:
    """Reads an AMC file, with the ASF beside it or in a folder above, at 120 frames per second.

    Raises:
        FileFormatError: A file is damaged, or there is no skeleton.
    """
    return [SkeletonTake(asf_amc.read_asf_amc(path))]


def standing_motion(
    take: SkeletonTake | Motion, stated: standing.Stated | None, trusted: bool
) -> Motion:
    """Returns the content of a file as a motion in meters, y up.

    Args:
        take: The content of the file; joints of a motion that this library wrote are in meters,
            y up, if they are trusted.
        stated: Unit, axis and rate as the user states them.
        trusted: Whether joints that no skeleton carries are in meters, y up.

    Raises:
        DataError: The names of the skeleton's joints are unknown, or its size or pose is nobody's.

    Warns:
        ReadingWarning: Something is a guess.
    """
    if isinstance(take, SkeletonTake):
        return motion_of(take, stated or standing.NOTHING)
    if trusted:
        return take
    # Bare joints.
    motion = take
    stated = stated or standing.NOTHING
    names = motion.skeleton.names
    if stated.fps is not None:
        motion = replace(motion, fps=stated.fps)
    if not set(HUMANML3D.names) <= set(names):
        return motion
    joints = motion.joints[:, [names.index(name) for name in HUMANML3D.names]]
    stance = standing.find_standing(joints, stated, 1.0)
    if stance.guesses:
        warnings.warn(f"a guess: {', '.join(stance.guesses)}", ReadingWarning, stacklevel=3)
    if stance.up == "y" and stance.meters == 1:
        return motion
    return replace(motion, joints=stance.meters * motion.joints @ stance.axes)


def motion_of(take: SkeletonTake, stated: standing.Stated = standing.NOTHING) -> Motion:
    """Returns an animation as a motion of our own skeleton of those names, else of HumanML3D's.

    Unit and axes are what is stated, else what the file says, else what the body shows; see
    `kinematics/standing.py`. The motion keeps the animation as `Motion.recorded`.

    Args:
        take: The animation in the file.
        stated: Unit, axis and rate as the user states them.

    Raises:
        DataError: The names of the skeleton's joints are unknown, or its size or pose is nobody's.

    Warns:
        ReadingWarning: Something is a guess.
    """
    animation, notes = take.animation, take.notes
    metadata = {key: value for key, value in notes.items() if key not in ("caption", "fps")}
    if stated.fps is not None:
        animation = replace(animation, fps=stated.fps)
    tips = animation.skeleton.end_sites
    joints_kept = [j for j in range(len(animation.skeleton)) if j not in tips]
    ours = OURS.get(tuple(animation.skeleton.names[j] for j in joints_kept))
    joint_map = humanoid.fitting_map(stated.joint_maps, animation.skeleton.names)
    joints = humanoid.to_humanml3d(animation, joint_map, take.declared)
    body = humanoid.find_humanoid(animation.skeleton, take.declared, joint_map)
    if ours is not None and not (stated.up or take.from_video) and standing.rest_stands(body):
        # Files of ours have y up, also where somebody lies.
        stated = replace(stated, up=standing.up_at_rest(body))
    stance = standing.find_standing(joints, stated, take.meters)
    guesses = list(stance.guesses)
    animation = standing.upright(animation, stance)
    joints = stance.meters * joints @ stance.axes
    if take.from_video and stated.fps is None:
        guesses.append(f"{animation.fps:g} frames per second (or --fps)")
    if take.path_is_missing:
        hips = [HUMANML3D.names.index(f"{side}_hip") for side in bone_names.SIDES]
        centered = joints - joints[:, hips].mean(axis=1, keepdims=True)
        joints, _ = keypoints.grounded(centered, HUMANML3D.names, animation.fps)
        animation = replace(animation, root_positions=joints[:, 0])
        guesses.append("the path is what keeps standing feet in place")
    if guesses:
        warnings.warn(f"a guess: {', '.join(guesses)}", ReadingWarning, stacklevel=3)
    recorded = Recorded.of(animation, replace(body, skeleton=animation.skeleton), joints)
    if ours is not None:
        joints = animation.joints()[:, joints_kept]
    motion = Motion(
        joints, animation.fps, ours or HUMANML3D, str(notes.get("caption", "")), metadata
    )
    return motion.with_recorded(recorded)


def parse_notes(path: str | Path, text: Any) -> dict[str, Any]:
    """Returns the metadata that a file keeps as JSON.

    Raises:
        FileFormatError: It is no JSON, or no object.
    """
    notes = parse_json(str(text), path)
    if not isinstance(notes, dict):
        raise FileFormatError(
            path, f"its metadata are a {type(notes).__name__}, expected an object"
        )
    return notes
