"""SMPL's pose parameters as `.npz`, in the layouts that programs around SMPL read.

    .amass.npz   SMPL-H as AMASS publishes it: poses (frames, 156), trans, betas, dmpls, gender,
                 mocap_framerate; z up
    .smplx.npz   SMPL-X as AMASS publishes it: poses (frames, 165) and their parts, trans, betas,
                 gender, mocap_frame_rate; z up; what SMPL-X's Blender add-on loads
    .smpl.npz    the arguments of the `smplx` package: global_orient, body_pose (frames, 69),
                 transl, betas, gender, fps; y up

Rotations are axis times angle, relative to the parent, from SMPL's T-pose. SMPL's files are not
ours to ship, so two things are approximate: the T-pose is our own (`skeleton.BODY`), whose bones
point some 3° away from SMPL's in arms and legs, 6° to 13° in feet, hips, collarbones and spine; and
with `betas` of zero the body has SMPL's mean bone lengths, not the motion's. Fingers and face rest.
Loper et al., "SMPL", 2015; Mahmood et al., "AMASS", ICCV 2019.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, InputError
from latentmotion.formats.takes import numbered
from latentmotion.kinematics.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, Skeleton
from latentmotion.motion import Motion
from latentmotion.representation.canonical import rotations_from
from latentmotion.storage.files import atomic_file

_JOINTS, _SMPLX_JOINTS = len(HUMANML3D), 55
_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Takes what lies in our axes, y up, to AMASS's, z up."""

_PELVIS, _PELVIS_X = np.array([0, -0.22, 0.03]), np.array([0, -0.35, 0.01])
"""Where the templates of SMPL and SMPL-H, and that of SMPL-X, have their pelvis, to the centimeter:
`trans` moves the template, not the pelvis."""


@dataclass(frozen=True, eq=False)
class Parameters:
    """What all layouts hold."""

    turns: Float[np.ndarray, "frames joints 3"]
    """Rotation vectors of SMPL's first 22 or 24 joints."""
    trans: Float[np.ndarray, "frames 3"]
    """How far the template is moved, meters."""


def write_amass(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes SMPL-H as AMASS has it, a file for each motion.

    Raises:
        InputError: The skeleton is not SMPL's, or the folder cannot be written.
    """
    return _write(path, motions, _amass)


def write_smplx(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes SMPL-X as AMASS has it, a file for each motion.

    Raises:
        InputError: The skeleton is not SMPL's, or the folder cannot be written.
    """
    return _write(path, motions, _smplx)


def write_smpl(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes the arguments of the `smplx` package for SMPL, a file for each motion.

    Raises:
        InputError: The skeleton is not SMPL's, or the folder cannot be written.
    """
    return _write(path, motions, _smpl)


def is_smpl(keys: Collection[str]) -> bool:
    """Says whether a file has the keys of one of these layouts."""
    return {"poses", "trans"} <= set(keys) or {"global_orient", "body_pose"} <= set(keys)


def read_arrays(path: str | Path, arrays: Mapping[str, np.ndarray]) -> Motion:
    """Returns the motion of the arrays of a file, on our own bones: shape (`betas`) is not known.

    Raises:
        FileFormatError: Shapes or numbers are wrong, or the frame rate is missing.
    """
    is_z_up = "poses" in arrays
    poses, trans = _amass_rows(arrays) if is_z_up else _smpl_rows(arrays)
    if not len(poses) or poses.shape[1] < 3 * _JOINTS or trans.shape != (len(poses), 3):
        found = f"found poses {poses.shape} and trans {trans.shape}"
        raise FileFormatError(path, f"{found}, expected (frames, 66 or more) and (frames, 3)")
    if not (np.isfinite(poses).all() and np.isfinite(trans).all()):
        raise FileFormatError(path, "holds NaN or infinite numbers; cut or repair them")
    axes = _Z_UP if is_z_up else np.eye(3)
    rotations = matrix_from_axis_angle(poses[:, : 3 * _JOINTS].reshape(-1, _JOINTS, 3))
    rotations[:, 0] = axes.T @ rotations[:, 0]
    pelvis = _PELVIS_X if poses.shape[1] == 3 * _SMPLX_JOINTS else _PELVIS
    joints = _body(_JOINTS).forward_kinematics(rotations, (trans + pelvis) @ axes)
    notes = json.loads(str(arrays["metadata"])) if "metadata" in arrays else {}
    caption = str(arrays["caption"]) if "caption" in arrays else ""
    return Motion(joints.astype("f4"), _rate(path, arrays), caption=caption, metadata=notes)


def _parameters(
    motion: Motion, axes: Float[np.ndarray, "3 3"], pelvis: Float[np.ndarray, " 3"]
) -> Parameters:
    animation = motion.animation()
    names = animation.skeleton.names
    if names not in (HUMANML3D.names, BODY.names):
        problem = f"skeleton {motion.skeleton.name!r} does not have SMPL's joints"
        raise InputError(f"{problem}: it can be written as .bvh, .glb, .usdc, .csv or .npz")
    rotations = rotations_from(_body(len(names)), animation)
    rotations[:, 0] = axes @ rotations[:, 0]
    return Parameters(axis_angle_from_matrix(rotations), animation.root_positions @ axes.T - pelvis)


def _amass(motion: Motion) -> dict[str, Any]:
    parameters = _parameters(motion, _Z_UP, _PELVIS)
    return {
        "poses": _padded(parameters.turns, 52),
        "trans": parameters.trans,
        "betas": np.zeros(16),
        "dmpls": np.zeros((len(motion), 8)),
        "gender": np.array("neutral"),
        "mocap_framerate": np.array(motion.fps),
    }


def _smplx(motion: Motion) -> dict[str, Any]:
    parameters = _parameters(motion, _Z_UP, _PELVIS_X)
    poses = _padded(parameters.turns, _SMPLX_JOINTS)
    return {
        "poses": poses,
        "root_orient": poses[:, :3],
        "pose_body": poses[:, 3:66],
        "pose_jaw": poses[:, 66:69],
        "pose_eye": poses[:, 69:75],
        "pose_hand": poses[:, 75:],
        "trans": parameters.trans,
        "betas": np.zeros(16),
        "num_betas": np.array(16),
        "gender": np.array("neutral"),
        "surface_model_type": np.array("smplx"),
        "mocap_frame_rate": np.array(motion.fps),
        "mocap_time_length": np.array(motion.seconds),
    }


def _smpl(motion: Motion) -> dict[str, Any]:
    parameters = _parameters(motion, np.eye(3), _PELVIS)
    poses = _padded(parameters.turns, 24)
    return {
        "global_orient": poses[:, :3],
        "body_pose": poses[:, 3:],
        "transl": parameters.trans,
        "betas": np.zeros((1, 10)),
        "gender": np.array("neutral"),
        "fps": np.array(motion.fps),
    }


def _write(path: str | Path, motions: Sequence[Motion], layout: Any) -> list[Path]:
    paths = numbered(Path(path), len(motions))
    contents = [layout(motion) for motion in motions]
    for target, motion, arrays in zip(paths, motions, contents, strict=True):
        notes = json.dumps(dict(motion.metadata))
        arrays |= {"caption": np.array(motion.caption), "metadata": np.array(notes)}
        with atomic_file(target) as temporary:
            np.savez_compressed(temporary, **arrays)
    return paths


def _padded(turns: Float[np.ndarray, "frames joints 3"], joints: int) -> np.ndarray:
    """Returns the first 22 joints, and rest for all others, in rows."""
    whole = np.zeros((len(turns), joints, 3))
    whole[:, :_JOINTS] = turns[:, :_JOINTS]
    return whole.reshape(len(turns), -1)


def _amass_rows(arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    poses, trans = (np.asarray(arrays[key], np.float64) for key in ("poses", "trans"))
    return poses.reshape(len(poses), math.prod(poses.shape[1:])), trans


def _smpl_rows(arrays: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    parts = [np.asarray(arrays[key], np.float64) for key in ("global_orient", "body_pose")]
    rows = [part.reshape(len(part), math.prod(part.shape[1:])) for part in parts]
    trans = arrays["transl"] if "transl" in arrays else np.zeros((len(rows[0]), 3))
    return np.concatenate(rows, axis=1), np.asarray(trans, np.float64)


def _rate(path: str | Path, arrays: Mapping[str, np.ndarray]) -> float:
    for key in ("mocap_framerate", "mocap_frame_rate", "fps"):
        if key in arrays:
            return float(arrays[key])
    raise FileFormatError(path, "says no frame rate; expected mocap_framerate or fps")


def _body(joints: int) -> Skeleton:
    """Returns our T-pose with the first joints of SMPL."""
    return replace(
        BODY,
        names=BODY.names[:joints],
        parents=BODY.parents[:joints],
        offsets=BODY.offsets[:joints],
    )
