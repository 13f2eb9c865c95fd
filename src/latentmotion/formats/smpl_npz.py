"""SMPL's pose parameters as `.npz`, in the layouts that programs around SMPL read.

    .amass.npz   SMPL-H as AMASS publishes it: poses (frames, 156), trans, betas, dmpls, gender,
                 mocap_framerate; z up
    .smplx.npz   SMPL-X as AMASS publishes it: poses (frames, 165) and their parts, trans, betas,
                 gender, mocap_frame_rate; z up; what SMPL-X's Blender add-on loads
    .smpl.npz    the arguments of the `smplx` package: global_orient, body_pose (frames, 69),
                 transl, betas, gender, fps; y up
    .npy         SMPL-X as Motion-X publishes it: (frames, 322), y up, without a frame rate; read
                 only. Pose of root and body (66 numbers), hands (90), jaw (3), expression (50),
                 face (100), translation (3), betas (10)

Rotations are axis times angle, relative to the parent, from SMPL's T-pose. SMPL's files are not
ours to ship, so two things are approximate: the T-pose is our own (`skeleton.BODY`), whose bones
point some 3° away from SMPL's in arms and legs, 6° to 13° in feet, hips, collarbones and spine; and
with `betas` of zero the body has SMPL's mean bone lengths, not the motion's. Fingers and face rest.
Loper et al., "SMPL", 2015; Mahmood et al., "AMASS", ICCV 2019; Lin et al., "Motion-X", 2023.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats.takes import SkeletonTake, numbered, parse_notes
from latentmotion.kinematics.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, Animation, Skeleton
from latentmotion.motion import Motion
from latentmotion.representation.canonical import rotations_from
from latentmotion.storage.array_files import write_arrays
from latentmotion.storage.limits import MOST_NUMBER
from latentmotion.storage.reading import blamed_on

_RATES = ("mocap_framerate", "mocap_frame_rate", "fps")
_JOINTS, _SMPLX_JOINTS = len(HUMANML3D), 55
# From our axes, y up, to AMASS's, z up.
_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

PELVIS, _PELVIS_X = np.array([0, -0.22, 0.03]), np.array([0, -0.35, 0.01])
"""Pelvis in the templates of SMPL and SMPL-H, and in that of SMPL-X, to the centimeter: `trans`
moves the template, not the pelvis."""


def write_amass(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes SMPL-H parameters in AMASS's layout, a file for each motion.

    Raises:
        InputError: The skeleton is not SMPL's, or the folder cannot be written.
    """

    def layout(motion: Motion) -> dict[str, Any]:
        poses, trans = _parameters(motion, _Z_UP, PELVIS, 52)
        return {
            "poses": poses,
            "trans": trans,
            "betas": np.zeros(16),
            "dmpls": np.zeros((len(motion), 8)),
            "gender": np.array("neutral"),
            "mocap_framerate": np.array(motion.fps),
        }

    return _write(path, motions, layout)


def write_smplx(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes SMPL-X parameters in AMASS's layout, a file for each motion.

    Raises:
        InputError: The skeleton is not SMPL's, or the folder cannot be written.
    """

    def layout(motion: Motion) -> dict[str, Any]:
        poses, trans = _parameters(motion, _Z_UP, _PELVIS_X, _SMPLX_JOINTS)
        return {
            "poses": poses,
            "root_orient": poses[:, :3],
            "pose_body": poses[:, 3:66],
            "pose_jaw": poses[:, 66:69],
            "pose_eye": poses[:, 69:75],
            "pose_hand": poses[:, 75:],
            "trans": trans,
            "betas": np.zeros(16),
            "num_betas": np.array(16),
            "gender": np.array("neutral"),
            "surface_model_type": np.array("smplx"),
            "mocap_frame_rate": np.array(motion.fps),
            "mocap_time_length": np.array(motion.seconds),
        }

    return _write(path, motions, layout)


def write_smpl(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes the arguments of the `smplx` package for SMPL, a file for each motion.

    Raises:
        InputError: The skeleton is not SMPL's, or the folder cannot be written.
    """

    def layout(motion: Motion) -> dict[str, Any]:
        poses, trans = _parameters(motion, np.eye(3), PELVIS, 24)
        return {
            "global_orient": poses[:, :3],
            "body_pose": poses[:, 3:],
            "transl": trans,
            "betas": np.zeros((1, 10)),
            "gender": np.array("neutral"),
            "fps": np.array(motion.fps),
        }

    return _write(path, motions, layout)


KEYS = frozenset(
    {"poses", "trans", "global_orient", "body_pose", "transl", "caption", "metadata"}
    | {"mocap_framerate", "mocap_frame_rate", "fps"}
)
"""Arrays that are read."""


def is_smpl(keys: Collection[str]) -> bool:
    """Returns whether a file has the keys of one of these layouts."""
    return {"poses", "trans"} <= set(keys) or {"global_orient", "body_pose"} <= set(keys)


def read_arrays(path: str | Path, arrays: Mapping[str, np.ndarray]) -> Motion:
    """Returns the motion in the arrays of a file, on our own bones: shape (`betas`) is ignored.

    Raises:
        FileFormatError: Shapes or numbers are wrong, or the frame rate is missing.
    """
    is_z_up = "poses" in arrays
    keys = ("poses",) if is_z_up else ("global_orient", "body_pose")
    kinds = ValueError, TypeError, KeyError
    with blamed_on(path, *kinds, problem="no poses of SMPL ({error})"):
        blocks = [np.asarray(arrays[key], np.float64) for key in keys]
        poses = np.concatenate(
            [block.reshape(len(block), math.prod(block.shape[1:])) for block in blocks], axis=1
        )
        still = np.zeros((len(poses), 3))
        trans = arrays["trans"] if is_z_up else arrays.get("transl", still)
        trans = np.asarray(trans, np.float64)
        rates = [float(arrays[key]) for key in _RATES if key in arrays]
    if not len(poses) or poses.shape[1] < 3 * _JOINTS or trans.shape != (len(poses), 3):
        shapes = f"found poses {poses.shape} and trans {trans.shape}"
        raise FileFormatError(path, f"{shapes}, expected (frames, 66 or more) and (frames, 3)")
    if not ((np.abs(poses) < MOST_NUMBER).all() and (np.abs(trans) < MOST_NUMBER).all()):
        raise FileFormatError(path, "holds NaN or infinite numbers; cut or repair them")
    axes = _Z_UP if is_z_up else np.eye(3)
    rotations = matrix_from_axis_angle(poses[:, : 3 * _JOINTS].reshape(-1, _JOINTS, 3))
    rotations[:, 0] = axes.T @ rotations[:, 0]
    pelvis = _PELVIS_X if poses.shape[1] == 3 * _SMPLX_JOINTS else PELVIS
    joints = smpl_body(_JOINTS).forward_kinematics(rotations, (trans + pelvis) @ axes)
    notes = parse_notes(path, arrays["metadata"]) if "metadata" in arrays else {}
    caption = str(arrays["caption"]) if "caption" in arrays else ""
    if not rates:
        raise FileFormatError(path, "says no frame rate; expected mocap_framerate or fps")
    with blamed_on(path):
        return Motion(joints, rates[0], caption=caption, metadata=notes)


MOTIONX_NUMBERS = 322
"""Numbers of a frame of Motion-X."""

# Motion-X has 30 frames per second, but for HumanML3D's and GRAB's, which its scripts take at 20.
_MOTIONX_FPS, _AT_20 = 30.0, {"humanml", "GRAB"}


def motionx_take(path: str | Path, frames: Float[np.ndarray, "frames 322"]) -> SkeletonTake:
    """Returns the body in an array of Motion-X, on our own bones; hands and face are left out.

    Args:
        path: Its file; a folder `humanml` or `GRAB` says that it has 20 frames per second.
        frames: The array.

    Raises:
        FileFormatError: It has no frames, or numbers that are none.
    """
    frames = np.asarray(frames, np.float64)
    if not len(frames) or not (np.abs(frames) < MOST_NUMBER).all():
        raise FileFormatError(path, "holds no frames, or NaN or infinite numbers; cut or repair it")
    rotations = matrix_from_axis_angle(frames[:, : 3 * _JOINTS].reshape(-1, _JOINTS, 3))
    fps = 20.0 if _AT_20 & set(Path(path).parts) else _MOTIONX_FPS
    return SkeletonTake(
        Animation(smpl_body(_JOINTS), rotations, frames[:, 309:312] + _PELVIS_X, fps)
    )


def _parameters(
    motion: Motion,
    axes: Float[np.ndarray, "3 3"],
    pelvis: Float[np.ndarray, " 3"],
    joints: int,
) -> tuple[Float[np.ndarray, "frames values"], Float[np.ndarray, "frames 3"]]:
    """Returns pose parameters of so many joints, and the translation of the template in meters.

    The first 22 joints are the motion's; all others rest.
    """
    animation = motion.animation()
    names = animation.skeleton.names
    if names not in (HUMANML3D.names, BODY.names):
        problem = f"skeleton {motion.skeleton.name!r} does not have SMPL's joints"
        raise InputError(f"{problem}: it can be written as .bvh, .glb, .usdc, .csv or .npz")
    rotations = rotations_from(smpl_body(len(names)), animation)
    rotations[:, 0] = axes @ rotations[:, 0]
    poses = np.zeros((len(rotations), joints, 3))
    poses[:, :_JOINTS] = axis_angle_from_matrix(rotations)[:, :_JOINTS]
    return poses.reshape(len(poses), -1), animation.root_positions @ axes.T - pelvis


def _write(
    path: str | Path, motions: Sequence[Motion], layout: Callable[[Motion], dict[str, Any]]
) -> list[Path]:
    # All parameters before the first file, so that nothing is written if a skeleton is not SMPL's.
    layouts, paths = [layout(motion) for motion in motions], numbered(Path(path), len(motions))
    for target, motion, arrays in zip(paths, motions, layouts, strict=True):
        notes = json.dumps(dict(motion.metadata))
        arrays |= {"caption": np.array(motion.caption), "metadata": np.array(notes)}
        write_arrays(target, arrays)
    return paths


def smpl_body(joints: int) -> Skeleton:
    """Returns our T-pose with the first joints of SMPL.

    Args:
        joints: How many.
    """
    return replace(
        BODY,
        names=BODY.names[:joints],
        parents=BODY.parents[:joints],
        offsets=BODY.offsets[:joints],
    )
