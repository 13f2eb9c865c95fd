"""SMPL: pose parameters as `.npz`, in the layouts of programs around SMPL; results of trackers.

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

Results of trackers that fit SMPL to videos, as their own programs save them.

    WHAM         wham_output.pkl        {person: {pose_world (T, 72), trans_world, frame_ids, …}}
    GVHMR        hmr4d_results.pt       {smpl_params_global: {global_orient, body_pose, transl}, …}
    4D-Humans    demo_….pkl             {frame: {tid, smpl: [{global_orient, body_pose}, …], …}}
    ROMP         video_results.npz      {sequence_results: {person: {smpl_thetas, frame_id, …}}, …}
    TRAM         hps/hps_track_0.npy    {pred_rotmat, pred_trans, frame}; camera.npy above it
    AIST++       .pkl                   {smpl_poses (T, 72), smpl_trans, smpl_scaling}
    VIBE         vibe_output.pkl        {person: {pose (T, 72), frame_ids, …}}

Each person is a take, who is seen longest first. Frames in which somebody was not seen are filled
in. None of these files says its frame rate: 30 is a guess, which `--fps` overrules.

Results in the world keep their path. In a camera's axes depth trembles and the camera may move, so
there the path is the one that keeps standing feet in place.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, InputError, ReadingWarning
from latentmotion.formats import numbered
from latentmotion.formats.takes import SkeletonTake, parse_notes
from latentmotion.kinematics import rotations as rot
from latentmotion.kinematics.skeleton import BODY, HUMANML3D, Animation, Skeleton
from latentmotion.motion import Motion
from latentmotion.representation.canonical import rotations_from
from latentmotion.storage import array_files, limits, reading, tensor_pickles

_RATES = ("mocap_framerate", "mocap_frame_rate", "fps")
_JOINTS, _SMPLX_JOINTS = len(HUMANML3D), 55
# From our axes, y up, to AMASS's, z up.
_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

# Pelvis in the templates of SMPL and SMPL-H, and in that of SMPL-X, to the centimeter: `trans`
# moves the template, not the pelvis.
PELVIS, _PELVIS_X = np.array([0, -0.22, 0.03]), np.array([0, -0.35, 0.01])


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


# Arrays that are read.
KEYS = frozenset(
    {"poses", "trans", "global_orient", "body_pose", "transl", "caption", "metadata"}
    | {"mocap_framerate", "mocap_frame_rate", "fps"}
)


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
    with reading.blamed_on(path, *kinds, problem="no poses of SMPL ({error})"):
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
    if not (
        (np.abs(poses) < limits.MOST_NUMBER).all() and (np.abs(trans) < limits.MOST_NUMBER).all()
    ):
        raise FileFormatError(path, "holds NaN or infinite numbers; cut or repair them")
    axes = _Z_UP if is_z_up else np.eye(3)
    rotations = rot.matrix_from_axis_angle(poses[:, : 3 * _JOINTS].reshape(-1, _JOINTS, 3))
    rotations[:, 0] = axes.T @ rotations[:, 0]
    pelvis = _PELVIS_X if poses.shape[1] == 3 * _SMPLX_JOINTS else PELVIS
    joints = smpl_body(_JOINTS).forward_kinematics(rotations, (trans + pelvis) @ axes)
    notes = parse_notes(path, arrays["metadata"]) if "metadata" in arrays else {}
    caption = str(arrays["caption"]) if "caption" in arrays else ""
    if not rates:
        raise FileFormatError(path, "says no frame rate; expected mocap_framerate or fps")
    with reading.blamed_on(path):
        return Motion(joints, rates[0], caption=caption, metadata=notes)


MOTIONX_NUMBERS = 322  # Numbers of a frame of Motion-X.

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
    if not len(frames) or not (np.abs(frames) < limits.MOST_NUMBER).all():
        raise FileFormatError(path, "holds no frames, or NaN or infinite numbers; cut or repair it")
    rotations = rot.matrix_from_axis_angle(frames[:, : 3 * _JOINTS].reshape(-1, _JOINTS, 3))
    fps = 20.0 if _AT_20 & set(Path(path).parts) else _MOTIONX_FPS
    return SkeletonTake(
        Animation(smpl_body(_JOINTS), rotations, frames[:, 309:312] + _PELVIS_X, fps)
    )


def _parameters(
    motion: Motion, axes: Float[np.ndarray, "3 3"], pelvis: Float[np.ndarray, " 3"], joints: int
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
    poses[:, :_JOINTS] = rot.axis_angle_from_matrix(rotations)[:, :_JOINTS]
    return poses.reshape(len(poses), -1), animation.root_positions @ axes.T - pelvis


def _write(
    path: str | Path, motions: Sequence[Motion], layout: Callable[[Motion], dict[str, Any]]
) -> list[Path]:
    # All parameters before the first file, so that nothing is written if a skeleton is not SMPL's.
    layouts, paths = [layout(motion) for motion in motions], numbered(Path(path), len(motions))
    for target, motion, arrays in zip(paths, motions, layouts, strict=True):
        notes = json.dumps(dict(motion.metadata))
        arrays |= {"caption": np.array(motion.caption), "metadata": np.array(notes)}
        array_files.write_arrays(target, arrays)
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


# Frames per second that videos usually have, and that GVHMR and TRAM take.
_FPS = 30.0

# Share of the longest person's frames below which somebody is left out: glimpses, mistakes.
_SHORTEST = 0.1

# TRAM's folder of persons, and its file of the camera beside that.
_PERSONS, _CAMERA = "hps", "camera.npy"


# A person in the frames in which it is seen: rotations of SMPL's first joints relative to their
# parents; translations of the template in the world, meters, None in a camera's axes; numbers of
# the frames, rising.
PersonTrack = tuple[np.ndarray, np.ndarray | None, np.ndarray]


def read(path: str | Path) -> list[SkeletonTake]:
    """Reads the persons in a file of results.

    Raises:
        FileFormatError: The file is damaged, holds code, or no poses of SMPL.

    Warns:
        ReadingWarning: Frames are filled in.
    """
    content = tensor_pickles.load(path)
    kinds = ValueError, TypeError, KeyError, IndexError, AttributeError
    with reading.blamed_on(path, *kinds, problem="no results of SMPL that are known ({error})"):
        tracks = [_track(person, Path(path)) for person in _persons(content)]
    if not tracks:
        keys = ", ".join(map(str, list(content)[:8])) if isinstance(content, Mapping) else ""
        raise FileFormatError(
            path,
            f"found no poses of SMPL in it ({keys or type(content).__name__}); expected results of "
            "WHAM, GVHMR, 4D-Humans, ROMP, TRAM, VIBE or AIST++",
        )
    tracks.sort(key=lambda track: -len(track[2]))
    least = _SHORTEST * len(tracks[0][2])
    takes = []
    for rotations, trans, frames in (track for track in tracks if len(track[2]) >= least):
        whole = np.arange(frames[0], frames[-1] + 1)
        if len(whole) > limits.MOST_FRAMES:
            raise FileFormatError(path, f"a person of more than {limits.MOST_FRAMES:,} frames")
        if lacking := len(whole) - len(frames):  # frames in which the person was not seen
            problem = f"{lacking} of {len(whole)} frames in which a person was not seen"
            warnings.warn(f"{path}: {problem} are filled in", ReadingWarning, stacklevel=2)
            after = np.searchsorted(frames, whole)
            before = np.maximum(after - (frames[after] != whole), 0)
            share = (whole - frames[before]) / np.maximum(frames[after] - frames[before], 1)
            ends = rot.quaternion_from_matrix(rotations)
            rotations = rot.matrix_from_quaternion(
                rot.slerp(ends[before], ends[after], share[:, None])
            )
            if trans is not None:
                trans = trans[before] + share[:, None] * (trans[after] - trans[before])
        root = np.zeros((len(rotations), 3)) if trans is None else trans + PELVIS
        animation = Animation(smpl_body(_JOINTS), rotations, root, _FPS)
        takes.append(SkeletonTake(animation, from_video=True, path_is_missing=trans is None))
    return takes


def _persons(content: Any) -> Iterator[Mapping[str, Any]]:
    """Yields what is said of each person."""
    match content:
        case np.ndarray(shape=()):
            yield from _persons(content.item())
        case {"smpl_params_global": dict(world)}:
            yield {**world, "world": True}
        case {"sequence_results": persons, "results": frames}:
            yield from _persons(_plain(persons) or _plain(frames))
        case {"results": frame} if len(content) == 1:
            yield from _persons({"frame": _plain(frame)})
        case dict() if any(keys <= content.keys() for keys in _PERSON):
            yield content
        case dict():
            values = [_plain(value) for value in content.values()]
            inside = [value.keys() for value in values if isinstance(value, Mapping)]
            romp = any("smpl_thetas" in keys and "frame_id" not in keys for keys in inside)
            if romp or any({"tid", "smpl"} <= keys for keys in inside):  # frames of many persons
                yield from _by_frame(values)
            else:
                for value in values:
                    yield from _persons(value)
        case list():
            for value in content:
                yield from _persons(value)


# Keys of which a person has at least one set.
_PERSON = (
    *({"pose_world"}, {"pred_rotmat"}, {"smpl_poses"}, {"global_orient", "body_pose"}),
    *({"smpl_thetas", "frame_id"}, {"pose", "betas"}, {"poses", "trans"}),
)


def _plain(value: Any) -> Any:
    """Returns what an array of a single object holds."""
    return value.item() if isinstance(value, np.ndarray) and not value.shape else value


def _by_frame(frames: Sequence[Any]) -> Iterator[Mapping[str, Any]]:
    """Yields persons of 4D-Humans, by their numbers, or the first of ROMP in each frame."""
    persons: dict[int, dict[str, list[Any]]] = {}
    for number, frame in enumerate(frames):
        if not isinstance(frame, Mapping):
            continue
        if "smpl_thetas" in frame:
            numbers = np.asarray(frame.get("track_ids", [0])).reshape(-1).tolist()
            poses = [{"smpl_thetas": pose} for pose in frame["smpl_thetas"][: len(numbers)]]
        else:
            ids, smpl = frame["tid"], frame["smpl"]
            pairs = [
                (n, pose) for n, pose in zip(ids, smpl, strict=False) if isinstance(pose, Mapping)
            ]
            numbers, poses = [int(n) for n, _ in pairs], [pose for _, pose in pairs]
        for person, values in zip(numbers, poses, strict=True):
            rows = persons.setdefault(person, {"frame_id": []})
            rows["frame_id"].append(number)
            for key in ("smpl_thetas", "global_orient", "body_pose"):
                if key in values:
                    rows.setdefault(key, []).append(np.asarray(values[key]))
    yield from persons.values()


def _track(person: Mapping[str, Any], path: Path) -> PersonTrack:
    """Returns a person's poses."""

    def value(*keys: str) -> Any:
        return next((person[key] for key in keys if person.get(key) is not None), None)

    parts = [value("pose_world", "pred_rotmat", "smpl_poses", "smpl_thetas", "poses")]
    if parts[0] is None and "global_orient" in person:
        parts = [person["global_orient"], person["body_pose"]]
    elif parts[0] is None:
        parts = [person["pose"]]
    arrays = [np.asarray(part, np.float64) for part in parts]
    if not all((np.abs(array) < limits.MOST_NUMBER).all() for array in arrays):
        raise ValueError("numbers that are not finite")
    matrices = [
        array.reshape(len(array), -1, 3, 3)
        if array.ndim >= 4 and array.shape[-2:] == (3, 3)
        else rot.matrix_from_axis_angle(array.reshape(len(array), -1, 3))
        for array in arrays
    ]
    rotations = np.concatenate(matrices, axis=1)
    if len(rotations) > limits.MOST_FRAMES or rotations.shape[1] < _JOINTS:
        raise ValueError(f"poses of the shape {rotations.shape}")
    ids = value("frame_ids", "frame_id", "frame")
    frames = np.arange(len(rotations)) if ids is None else np.asarray(ids).reshape(-1)
    frames = frames.astype(np.int64)
    if len(frames) != len(rotations) or not len(frames):
        raise ValueError(f"{len(frames)} numbers of frames for {len(rotations)} poses")
    rotations = rotations[:, :_JOINTS].copy()
    # The path in the world, if that is what the file has.
    names = ["trans_world", "smpl_trans"] + ["transl"] * ("world" in person)
    path_in_world, trans = value(*names, *["trans"] * ("poses" in person)), None
    if path_in_world is not None:
        scale = person.get("smpl_scaling", 1.0) if "smpl_trans" in person else 1.0
        trans = np.asarray(path_in_world, np.float64).reshape(-1, 3) / float(np.ravel(scale)[0])
        if len(trans) != len(rotations) or not (np.abs(trans) < limits.MOST_NUMBER).all():
            raise ValueError(f"a path of the shape {trans.shape} for {len(rotations)} poses")
    folder = path.absolute().parent
    camera_file = folder.parent / _CAMERA
    if "pred_rotmat" in person and folder.name == _PERSONS and camera_file.is_file():  # TRAM's
        camera = _plain(tensor_pickles.load(camera_file))
        turn = np.asarray(camera["world_cam_R"], np.float64)[frames]
        shift = np.asarray(camera["world_cam_T"], np.float64)[frames]
        trans = np.asarray(person["pred_trans"], np.float64).reshape(-1, 3)
        rotations[:, 0] = turn @ rotations[:, 0]
        trans = np.einsum("tab,tb->ta", turn, trans + PELVIS) + shift - PELVIS
    frames, order = np.unique(frames, return_index=True)
    return rotations[order], None if trans is None else trans[order], frames
