"""Results of trackers that fit SMPL to videos, as their own programs save them.

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

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from latentmotion.errors import FileFormatError, ReadingWarning
from latentmotion.formats.smpl_npz import PELVIS, smpl_body
from latentmotion.formats.takes import SkeletonTake
from latentmotion.kinematics.rotations import (
    matrix_from_axis_angle,
    matrix_from_quaternion,
    quaternion_from_matrix,
    slerp,
)
from latentmotion.kinematics.skeleton import HUMANML3D, Animation
from latentmotion.storage import tensor_pickles
from latentmotion.storage.limits import MOST_FRAMES, MOST_NUMBER
from latentmotion.storage.reading import blamed_on

_JOINTS = len(HUMANML3D)

# Frames per second that videos usually have, and that GVHMR and TRAM take.
_FPS = 30.0

# Share of the longest person's frames below which somebody is left out: glimpses, mistakes.
_SHORTEST = 0.1

# TRAM's folder of persons, and its file of the camera beside that.
_PERSONS, _CAMERA = "hps", "camera.npy"


@dataclass(frozen=True, eq=False)
class PersonTrack:
    """A person in the frames in which it is seen."""

    rotations: Float[np.ndarray, "frames joints 3 3"]
    """Of SMPL's first joints relative to their parents."""
    trans: Float[np.ndarray, "frames 3"] | None
    """Translation of the template in the world, meters; None in a camera's axes."""
    frames: Int[np.ndarray, " frames"]
    """Numbers of the frames, rising."""


def read(path: str | Path) -> list[SkeletonTake]:
    """Reads the persons in a file of results.

    Raises:
        FileFormatError: The file is damaged, holds code, or no poses of SMPL.

    Warns:
        ReadingWarning: Frames are filled in.
    """
    content = tensor_pickles.load(path)
    kinds = ValueError, TypeError, KeyError, IndexError, AttributeError
    with blamed_on(path, *kinds, problem="no results of SMPL that are known ({error})"):
        tracks = [_track(person, Path(path)) for person in _persons(content)]
    if not tracks:
        keys = ", ".join(map(str, list(content)[:8])) if isinstance(content, Mapping) else ""
        raise FileFormatError(
            path,
            f"found no poses of SMPL in it ({keys or type(content).__name__}); expected results of "
            "WHAM, GVHMR, 4D-Humans, ROMP, TRAM, VIBE or AIST++",
        )
    tracks.sort(key=lambda track: -len(track.frames))
    least = _SHORTEST * len(tracks[0].frames)
    return [_take(path, track) for track in tracks if len(track.frames) >= least]


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
    rotations = np.concatenate([_matrices(part) for part in parts], axis=1)
    if len(rotations) > MOST_FRAMES or rotations.shape[1] < _JOINTS:
        raise ValueError(f"poses of the shape {rotations.shape}")
    ids = value("frame_ids", "frame_id", "frame")
    frames = np.arange(len(rotations)) if ids is None else np.asarray(ids).reshape(-1)
    frames = frames.astype(np.int64)
    if len(frames) != len(rotations) or not len(frames):
        raise ValueError(f"{len(frames)} numbers of frames for {len(rotations)} poses")
    rotations, trans = rotations[:, :_JOINTS].copy(), _translation(person, len(rotations))
    if "pred_rotmat" in person:
        rotations, trans = _in_world(rotations, person["pred_trans"], frames, path)
    frames, order = np.unique(frames, return_index=True)
    return PersonTrack(rotations[order], None if trans is None else trans[order], frames)


def _matrices(value: Any) -> Float[np.ndarray, "frames joints 3 3"]:
    """Returns rotations that are kept as matrices or rotation vectors."""
    array = np.asarray(value, np.float64)
    if not (np.abs(array) < MOST_NUMBER).all():
        raise ValueError("numbers that are not finite")
    if array.ndim >= 4 and array.shape[-2:] == (3, 3):
        return array.reshape(len(array), -1, 3, 3)
    return matrix_from_axis_angle(array.reshape(len(array), -1, 3))


def _translation(person: Mapping[str, Any], count: int) -> Float[np.ndarray, "frames 3"] | None:
    """Returns the path in the world, if that is what the file has."""
    scale = 1.0
    if "trans_world" in person:
        value = person["trans_world"]
    elif "smpl_trans" in person:
        value, scale = person["smpl_trans"], float(np.ravel(person.get("smpl_scaling", 1.0))[0])
    elif person.get("world") and "transl" in person:
        value = person["transl"]
    elif "poses" in person:
        value = person["trans"]
    else:
        return None
    trans = np.asarray(value, np.float64).reshape(-1, 3) / scale
    if len(trans) != count or not (np.abs(trans) < MOST_NUMBER).all():
        raise ValueError(f"a path of the shape {trans.shape} for {count} poses")
    return trans


def _in_world(
    rotations: Float[np.ndarray, "frames joints 3 3"],
    trans: Any,
    frames: Int[np.ndarray, " frames"],
    path: Path,
) -> tuple[Float[np.ndarray, "frames joints 3 3"], Float[np.ndarray, "frames 3"] | None]:
    """Returns TRAM's poses in the world, if the file of its camera is at its place."""
    folder = path.absolute().parent
    file = folder.parent / _CAMERA
    if folder.name != _PERSONS or not file.is_file():
        return rotations, None
    camera = _plain(tensor_pickles.load(file))
    turn = np.asarray(camera["world_cam_R"], np.float64)[frames]
    shift = np.asarray(camera["world_cam_T"], np.float64)[frames]
    trans = np.asarray(trans, np.float64).reshape(-1, 3)
    rotations[:, 0] = turn @ rotations[:, 0]
    return rotations, np.einsum("tab,tb->ta", turn, trans + PELVIS) + shift - PELVIS


def _take(path: str | Path, track: PersonTrack) -> SkeletonTake:
    """Returns a take, frames filled in where the person was not seen."""
    rotations, trans, frames = track.rotations, track.trans, track.frames
    whole = np.arange(frames[0], frames[-1] + 1)
    if len(whole) > MOST_FRAMES:
        raise FileFormatError(path, f"a person of more than {MOST_FRAMES:,} frames")
    if len(whole) > len(frames):
        lacking = (
            f"{len(whole) - len(frames)} of {len(whole)} frames in which a person was not seen"
        )
        warnings.warn(f"{path}: {lacking} are filled in", ReadingWarning, stacklevel=2)
        after = np.searchsorted(frames, whole)
        before = np.maximum(after - (frames[after] != whole), 0)
        share = (whole - frames[before]) / np.maximum(frames[after] - frames[before], 1)
        ends = quaternion_from_matrix(rotations)
        rotations = matrix_from_quaternion(slerp(ends[before], ends[after], share[:, None]))
        if trans is not None:
            trans = trans[before] + share[:, None] * (trans[after] - trans[before])
    root = np.zeros((len(rotations), 3)) if trans is None else trans + PELVIS
    animation = Animation(smpl_body(_JOINTS), rotations, root, _FPS)
    return SkeletonTake(animation, from_video=True, path_is_missing=trans is None)
