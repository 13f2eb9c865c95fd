"""Transfer: a motion retargeted to bones of other lengths, rest directions and numbers.

D is a joint's rotation in the world away from its rest pose, d its bone's direction at rest.

    limbs          D_rig = D A,      A the shortest rotation, joint by joint down the limb, with
                                     A d_rig = d:  bones point where the source's point, and
                                     A-poses become T-poses without a twist
    feet           D_rig = D A,      A about the vertical: a level sole stays level
    pelvis, head,
    collars        D_rig = D
    spine, neck    D_rig interpolated at k/n from pelvis to chest, from chest to head
    fingers        as limbs, where both bodies name them
    all others     at rest relative to their parent

Hips move as the source's do, times the ratio of the legs. `feet.py` puts the feet on the floor,
`hands.py` palms and fingertips at their goals.
A motion that was recorded on this very skeleton keeps every rotation and every position.

Root motion is the path along the floor and the heading, without the sway of the steps. It moves the
pelvis, or the rig's root bone with the pelvis relative to it, as engines expect, or nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.pipeline import ground_path
from latentmotion.cleanup.smoothing import gaussian
from latentmotion.errors import DataError, InputError
from latentmotion.formats import bvh, fbx, numbered
from latentmotion.kinematics import rotations as rot
from latentmotion.kinematics.bone_names import SIDES
from latentmotion.kinematics.humanoid import Humanoid, fingers_below
from latentmotion.kinematics.skeleton import Animation, posed
from latentmotion.kinematics.standing import RestPose, facing_at_rest
from latentmotion.motion import Motion
from latentmotion.progress import counted
from latentmotion.render.mannequin import Mannequin
from latentmotion.retarget import feet, flesh, hands
from latentmotion.retarget.rig import Rig, RigPose, Rotations, SourceCharacter

_LIMBS = (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))

# Greatest difference of offsets between equal skeletons, as a share of the leg's length.
_SAME = 0.01

# Standard deviation, seconds, of the Gaussian that takes the sway of steps out of the heading.
_SWAY = 0.25

# Target of root motion: the pelvis, the rig's root bone, or nothing (in place).
RootMotion = Literal["pelvis", "root", "none"]


def retarget(source: Motion | Animation, rig: Rig, body: Humanoid | None = None) -> Animation:
    """Retargets a motion to a rig.

    Args:
        source: The motion, its floor at height 0. Where it was read from a skeleton, or is an
            animation, bones whose joints are known by their names keep their twist.
        rig: The skeleton to move.
        body: The source's joints by our names; by default found by their names.

    Returns:
        The animation of the rig's skeleton, meters, y up. `Rig.in_file` converts it to the axes and
        unit of the rig's file.

    Raises:
        DataError: The joints of the source are unknown.
    """
    character = SourceCharacter.of(source, body)
    theirs, ours = character.body.skeleton, rig.skeleton
    axes, same = RestPose.of(character.body).axes, _SAME * rig.leg
    alike = theirs.names == ours.names and theirs.parents == ours.parents
    if alike and np.abs(np.asarray(theirs.offsets) @ axes - ours.offsets).max() < same:
        facing = facing_at_rest(character.body)  # a rig's rest pose faces +z, whatever its file's
        joints = character.joints @ facing
        root = joints[:, 0] - (0, rig.floor, 0)
        return posed(rig.skeleton, facing.T @ character.world, joints, character.fps, root)
    body, joints, world = character.body, rig.body.joints, character.world
    rotations = {rig.body.pelvis: world[:, body.pelvis], **_limbs(character, rig)}
    spine = [world[:, joint] for joint in (body.pelvis, *body.spine)]
    rotations |= _chain(spine, rig.body.spine)
    if "head" in body.joints:
        neck = [world[:, joint] for joint in (body.chest, *body.neck)]
        rotations |= _chain(neck, rig.body.neck)
    aligned = dict.fromkeys(("head", *(f"{side}_collar" for side in SIDES)), np.eye(3))
    for side in SIDES:
        align = feet.align_foot(rig, character, side)
        aligned |= {f"{side}_ankle": align, f"{side}_foot": align}
    for name, align in aligned.items():
        if name in body.joints and name in joints:
            rotations[joints[name]] = character.rotation(name) @ align
    # The middle of the hips moves as the source's, at the scale of the legs.
    hips = np.mean([character.position(f"{side}_hip") for side in SIDES], axis=0)
    scale = rig.leg / character.leg
    standing = scale * character.standing_height("ankle")
    rest = np.mean([rig.rest()[rig.body.joints[f"{side}_ankle"], 1] for side in SIDES])
    pose = RigPose(rig, rotations, scale * hips + (0, rest - standing, 0))
    goals = source.metadata.get("goals", ()) if isinstance(source, Motion) else ()
    return hands.place_hands(feet.ground_feet(pose, character), character, goals).animation(
        character.fps
    )


class CharacterFigure:
    """A `Figure` of a character: its surface and the motion on its bones.

    Args:
        rig: The character.

    Raises:
        FileFormatError: The file is damaged.
        InputError: The character has no surface.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig, self._skin = rig, flesh.surface_of(rig)

    def __call__(self, motion: Motion) -> tuple[Mannequin, Animation]:
        """Returns the surface and the motion on the rig."""
        return self._skin, retarget(motion, self._rig)


def with_root_motion(animation: Animation, rig: Rig, root_motion: RootMotion) -> Animation:
    """Returns an animation of a rig whose root motion moves something else than the pelvis.

    Raises:
        DataError: The rig has no root bone above its pelvis.
    """
    if root_motion == "pelvis":
        return animation
    bone, pelvis = rig.root_motion_bone, rig.body.pelvis
    if root_motion == "root":
        check_root_bone(rig)
    rest, joints = rig.rest()[pelvis] * (1, 0, 1), animation.joints()
    path = ground_path(joints[:, [pelvis]], animation.fps) - rest
    root, translations = animation.root_positions, animation.translations
    if bone == 0 or translations is None:
        return replace(animation, root_positions=root - path)
    moved = translations.copy()
    if root_motion == "none":
        moved[:, bone] -= path  # nothing above it rotates
        return replace(animation, root_positions=root, translations=moved)
    # The root bone turns with the body's heading, smoothed; what hangs between it and the moving
    # bone, with it.
    at = rig.body.joints
    across = sum(
        joints[:, at[f"right_{part}"]] - joints[:, at[f"left_{part}"]]
        for part in ("hip", "shoulder")
    )
    yaw = np.unwrap(np.arctan2(across[:, 2], -across[:, 0]))  # type: ignore[index]
    smooth = gaussian(yaw, _SWAY * animation.fps)
    facing = rot.matrix_from_axis_angle(smooth[:, None] * np.array([0.0, 1.0, 0.0]))
    back, rotations = np.swapaxes(facing, -1, -2), animation.rotations.copy()
    above = rig.body.lines[bone][1:-1]  # without the root
    offset = np.sum([moved[:, joint] for joint in above], axis=0) if above else 0.0
    place = moved[:, bone] + offset - path
    moved[:, bone] = np.einsum("fab,fb->fa", back, place) - offset
    rotations[:, 0], rotations[:, bone] = facing, back @ rotations[:, bone]
    return replace(animation, rotations=rotations, root_positions=root + path, translations=moved)


def check_root_bone(rig: Rig) -> None:
    """Checks that a rig has a root bone above its pelvis, which root motion can move.

    Raises:
        DataError: It has none.
    """
    names = rig.skeleton.names
    if rig.root_motion_bone == 0:
        raise DataError(
            f"{rig.file.path} has no root bone above the pelvis: {names[0]!r} is the root and "
            "moves the body; leave root motion on the pelvis, or add a bone to the rig"
        )


def write(
    path: str | Path,
    rig: Rig,
    motions: Sequence[Motion],
    fps: float | None = None,
    names: Sequence[str] | None = None,
    root_motion: RootMotion = "pelvis",
) -> list[Path]:
    """Retargets motions to a rig and writes it.

    Args:
        path: `.glb`, `.gltf` or `.fbx`: the rig's file with the animations added; those of the same
            name are replaced; FBX by the user's Blender. `.bvh`: its skeleton, one file for each.
        rig: The rig.
        motions: At least one.
        fps: Frames per second of the animations; by default each motion's own.
        names: Names of the animations; by default their captions.
        root_motion: Target of the path along the floor.

    Returns:
        The files written.

    Raises:
        DataError: The rig has no root bone that root motion could move.
        InputError: The ending does not fit the rig, or the folder cannot be written.
    """
    target = Path(path)
    check_output(rig, target)
    if not motions:
        raise InputError(f"no motion to write to {target}, expected at least one")
    names = names or [motion.caption or f"take {n}" for n, motion in enumerate(motions, 1)]
    return write_animations(target, rig, retargeted(rig, motions, fps, root_motion), names)


def retargeted(
    rig: Rig,
    motions: Sequence[Motion],
    fps: float | None = None,
    root_motion: RootMotion = "pelvis",
) -> list[Animation]:
    """Returns what motions are on a rig; see `write`."""
    motions = motions if fps is None else [motion.resampled(fps) for motion in motions]
    return [
        with_root_motion(retarget(motion, rig), rig, root_motion)
        for motion in counted(motions, "retargeting")
    ]


def write_animations(
    target: Path, rig: Rig, animations: Sequence[Animation], names: Sequence[str]
) -> list[Path]:
    """Writes a rig with animations of it; see `write`."""
    if target.suffix.lower() in rig.file.endings:
        return rig.file.write(target, [rig.in_file(each) for each in animations], names)
    paths = numbered(target, len(animations))
    for output, animation in zip(paths, animations, strict=True):
        bvh.write_bvh(output, animation)
    return paths


def check_output(rig: Rig, path: Path) -> None:
    """Checks early that a rig can be written with such an ending.

    Raises:
        InputError: It cannot.
        MissingProgramError: FBX needs Blender, and there is none.
    """
    endings = dict.fromkeys((*rig.file.endings, ".bvh"))
    if path.suffix.lower() not in endings:
        raise InputError(
            f"{rig.file.path} cannot be written as {path.suffix or 'a file without ending'}; "
            f"expected {' or '.join(endings)}"
        )
    if path.suffix.lower() == ".fbx":
        fbx.check_ready()


def _chain(source: Sequence[Rotations], joints: Sequence[int]) -> dict[int, Rotations]:
    """Distributes the rotations of one chain evenly over another with any number of joints."""
    quaternions = [rot.quaternion_from_matrix(rotation) for rotation in source]
    rotations = {}
    for number, joint in enumerate(joints, 1):
        along = number / len(joints) * (len(source) - 1)
        before = min(int(along), max(len(source) - 2, 0))
        after = min(before + 1, len(source) - 1)
        between = rot.slerp(quaternions[before], quaternions[after], along - before)
        rotations[joint] = rot.matrix_from_quaternion(between)
    return rotations


def _limbs(source: SourceCharacter, rig: Rig) -> dict[int, Rotations]:
    rotations, rest, source_rest = {}, rig.rest(), source.rest()
    ours, theirs = rig.body.joints, source.body.joints
    for side in SIDES:
        for limb in _LIMBS:
            names = [f"{side}_{joint}" for joint in limb]
            align = np.eye(3)
            for upper, lower in pairwise(names):
                bone = rest[ours[lower]] - rest[ours[upper]]
                target = source_rest[theirs[lower]] - source_rest[theirs[upper]]
                align = rot.matrix_between(align @ bone, target) @ align
                rotations[ours[upper]] = source.rotation(upper) @ align
            rotations[ours[names[-1]]] = source.rotation(names[-1]) @ align
            if limb[-1] == "wrist":
                rotations |= _fingers(source, rig, names[-1], align)
    return rotations


def _fingers(
    source: SourceCharacter, rig: Rig, wrist: str, align: Float[np.ndarray, "3 3"]
) -> dict[int, Rotations]:
    """Returns rotations of the bones of fingers that both bodies name, below a wrist."""
    theirs, ours = (fingers_below(body, wrist) for body in (source.body, rig.body))
    source_rest, rest, rotations = source.rest(), rig.rest(), {}
    for finger in theirs.keys() & ours.keys():
        turn = align
        pairs = list(zip(theirs[finger], ours[finger], strict=False))
        for (start, upper), (end, lower) in pairwise([*pairs, (-1, -1)]):
            if end >= 0:
                bone, target = rest[lower] - rest[upper], source_rest[end] - source_rest[start]
                turn = rot.matrix_between(turn @ bone, target) @ turn
            rotations[upper] = source.world[:, start] @ turn
    return rotations
