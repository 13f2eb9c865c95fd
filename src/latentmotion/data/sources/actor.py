"""HumanAct12 and UESTC with SMPL's poses, as ACTOR distributes them.

UESTC: poses that VIBE estimated.

    info/names.txt              one video a line: aACTION_dVIEW_pSUBJECT_cSIDE_color.avi
    info/num_frames_min.txt     its frames, a line each
    info/action_classes.txt     names of the 40 actions
    vibe_cache_refined.pkl      lists by video: pose (frames, 72), joints3d (frames, 49, 3),
                                orig_cam (frames, 4): scales x and y, shifts x and y
    globtrans_usez.pkl          optional, lists by video: the camera's shifts in 3D (frames, 3)

Views of the second side are turned to the front, by 45° each; its view 8 circles the subject and
is left out. VIBE's camera is a weak perspective: a person that it scales by s is 2f / (w s) away.

HumanAct12: one file, `humanact12poses.pkl`.

    poses      a list of (frames, 72) rotation vectors, one per clip
    joints3D   a list of (frames, 24, 3) joints, of which the root trajectory is used
    y          the action of each clip, 0 .. 11

There is one split, `train`, on which its models are measured too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Split, mirror_words
from latentmotion.data.recording import (
    SMPL_JOINTS,
    Dropped,
    EncodedRecording,
    Label,
    PosedRecording,
    as_numbers,
)
from latentmotion.data.sources import OWNERS
from latentmotion.errors import DataError, FileFormatError
from latentmotion.kinematics.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from latentmotion.progress import counted
from latentmotion.storage import pickles
from latentmotion.storage.reading import read_text

UESTC = OWNERS["uestc"]

# 51 of the 118 subjects; the others are the test split.
TRAIN_SUBJECTS = frozenset(
    (
        *(1, 2, 6, 12, 13, 16, 21, 24, 28, 29, 30, 31, 33, 35, 39, 41, 42, 45, 47, 50, 52, 54, 55),
        *(57, 59, 61, 63, 64, 67, 69, 70, 71, 73, 77, 81, 84, 86, 87, 88, 90, 91, 93, 96, 99, 102),
        *(103, 104, 107, 108, 112, 113),
    )
)

SHORTEST = 45  # Frames of the shortest training clip; the test split has them all.

# Focal length and width of the image for which VIBE's camera is stated, pixels.
FOCAL, IMAGE = 500.0, 540.0

# The joint of VIBE's 49 whose trajectory is the root's.
_MID_HIP = 8

POSES, SHIFTS = "vibe_cache_refined.pkl", "globtrans_usez.pkl"
NAMES_FILE, FRAMES_FILE, ACTIONS_FILE = (
    f"info/{name}.txt" for name in ("names", "num_frames_min", "action_classes")
)
_KEYS = ("pose", "joints3d", "orig_cam")
_VIDEO = re.compile(r"a(\d+)_d(\d+)_p(\d+)_c(\d+)_")


@dataclass(frozen=True)
class Video:
    """What the name of a video states."""

    action: int  # Number of the action, from 0.
    view: int  # One of the 8 directions around the subject, or 8 for a camera that circles it.
    subject: int  # Number of the subject.
    side: int  # 1 for the camera in front; 2 for the other one.

    @property
    def split(self) -> Split:
        """Its split."""
        return "train" if self.subject in TRAIN_SUBJECTS else "test"

    @property
    def to_front(self) -> Float[np.ndarray, "3 3"]:
        """The rotation about the vertical after which the subject faces the camera."""
        eighths = 0 if self.side == 1 else self.view
        return matrix_from_axis_angle(np.array([0.0, -eighths * np.pi / 4, 0.0]))


def uestc_recordings(folder: Path, hold: int) -> Iterator[EncodedRecording | Dropped]:
    """Yields every video.

    Args:
        folder: Folder of the files.
        hold: Length in frames to which shorter clips are padded with their last frame.

    Raises:
        DataError: The folder lacks something, or its files do not fit together.
        FileFormatError: A file is damaged.
    """
    (names, frames, actions), poses, shifts = _read_files(folder)
    if len(frames) != len(names) or not all(count.strip().isdigit() for count in frames):
        raise DataError(
            f"{folder / FRAMES_FILE}: expected {len(names)} lines as {NAMES_FILE} has, a "
            "number in each"
        )
    for number, name in enumerate(counted(names, "videos")):
        match = _VIDEO.match(name)
        video = Video(*map(int, match.groups())) if match else None
        if video is None or video.action >= len(actions) or not 0 <= video.view <= 8:
            raise DataError(
                f"{folder / NAMES_FILE}: {name!r}; expected names like a0_d2_p013_c1_color.avi, "
                f"with actions below {len(actions)}, of which {ACTIONS_FILE} has a line each"
            )
        try:
            arrays = [as_numbers(poses[key][number]) for key in _KEYS]
            shift = None if shifts is None else as_numbers(shifts[number])
        except (ValueError, TypeError) as error:
            problem = f"{name} has no arrays of numbers ({error})"
            raise FileFormatError(folder / POSES, problem) from error
        pose, joints, camera = arrays
        length = len(pose) if pose.ndim else 0
        shapes, expected = [a.shape for a in arrays], [(length, 72), (length, 49, 3), (length, 4)]
        if shapes != expected:
            keys = ", ".join(_KEYS)
            raise FileFormatError(
                folder / POSES, f"{name}: {keys} of the shapes {shapes}, expected {expected}"
            )
        with np.errstate(all="ignore"):  # what is not finite is left out below
            shift = depth_shifts(camera) if shift is None else shift
        if shift.shape != (length, 3):
            problem = f"{name}: shifts {shift.shape}, expected ({length}, 3)"
            raise FileFormatError(folder / SHIFTS, problem)
        count = min(int(frames[number].strip()[:12]), length)
        root = joints[:count, _MID_HIP] + shift[:count]
        label = Label(
            id=name.removesuffix("_color.avi"),
            source=UESTC.name,
            origin=name,
            split=video.split,
            action=actions[video.action],
            mirrored_action=mirror_words(actions[video.action]),
        )
        reason = ""
        if video.side != 1 and video.view == 8:
            reason = "view 8 of side 2: the camera circles the subject"
        elif video.split == "train" and count < SHORTEST:
            reason = f"{count} frames, fewer than {SHORTEST}"
        if reason:
            yield Dropped(label.id, "clip", reason)
            continue
        # Turned to the front; the arrays are in the axes of its camera.
        turned = np.array(pose[:count], dtype=np.float64)
        first = video.to_front @ matrix_from_axis_angle(turned[:, :3])
        turned[:, :3] = axis_angle_from_matrix(first)
        yield PosedRecording(label, turned, root @ video.to_front.T).encode(hold)


def depth_shifts(camera: Float[np.ndarray, "frames 4"]) -> Float[np.ndarray, "frames 3"]:
    """Returns how a person moves by what VIBE's camera says, since the first frame, meters."""
    depth = 2 * FOCAL / (IMAGE * camera[:, 0])
    shifts = np.stack([camera[:, 2], camera[:, 3], depth], axis=-1)
    return shifts - shifts[:1]


def _read_files(folder: Path) -> tuple[list[list[str]], Mapping[str, Any], Any]:
    """Reads names, frames and actions as lines, lists by video, and shifts if there are any."""
    texts = []
    for path in (folder / NAMES_FILE, folder / FRAMES_FILE, folder / ACTIONS_FILE):
        if not path.is_file():
            raise DataError(
                f"no file {path}; the folder should hold {NAMES_FILE}, {FRAMES_FILE}, "
                f"{ACTIONS_FILE} and {POSES}, from {UESTC.url}"
            )
        try:
            texts.append(read_text(path).splitlines())
        except FileFormatError as error:
            raise DataError(f"{error}; it cannot be read as text: download it again") from error
    poses, videos = _lists(folder / POSES, _KEYS), len(texts[0])
    path = folder / SHIFTS
    shifts = pickles.load(path) if path.is_file() else None
    if shifts is not None:
        _check_list(path, "shifts", shifts)
        poses = {**poses, "shifts": shifts}
    for key, values in poses.items():
        if len(values) != videos:
            problem = f"{key} of {len(values)} videos, {NAMES_FILE} has {videos}"
            raise FileFormatError(path if key == "shifts" else folder / POSES, problem)
    return texts, poses, shifts


def _lists(path: Path, keys: Sequence[str]) -> dict[str, Any]:
    """Reads a pickled dictionary of lists, an entry of each for every clip."""
    content = pickles.load(path)
    if not isinstance(content, Mapping) or any(key not in content for key in keys):
        is_mapping = isinstance(content, Mapping)
        actual = ", ".join(map(str, content)) if is_mapping else type(content).__name__
        raise FileFormatError(path, f"expected {', '.join(keys)}, found {actual}")
    for key in keys:
        _check_list(path, key, content[key])
    return {key: content[key] for key in keys}


def _check_list(path: Path, what: str, values: Any) -> None:
    if not (isinstance(values, list | tuple) or (isinstance(values, np.ndarray) and values.ndim)):
        raise FileFormatError(path, f"{what} are a {type(values).__name__}, expected a list")


HUMANACT12 = OWNERS["humanact12"]

# Its labels, in the order of their numbers; each is its own mirror image.
ACTIONS = (
    *("warm_up", "walk", "run", "jump", "drink", "lift_dumbbell", "sit", "eat"),
    *("turn steering wheel", "phone", "boxing", "throw"),
)

_NEEDED = ("poses", "joints3D", "y")


def humanact12_recordings(path: Path, hold: int) -> Iterator[EncodedRecording | Dropped]:
    """Yields every clip.

    Args:
        path: The file.
        hold: Length in frames to which shorter clips are padded with their last frame.

    Raises:
        FileFormatError: The file cannot be read, or is laid out otherwise.
    """
    content = _lists(path, _NEEDED)
    counts = [len(content[key]) for key in _NEEDED]
    if len(set(counts)) > 1:
        raise FileFormatError(path, f"{' and '.join(map(str, counts))} clips; expected as many")
    if not all(isinstance(y, int | np.integer) for y in content["y"]):
        raise FileFormatError(path, "its actions are no whole numbers; is it another data set?")
    unknown = sorted({int(y) for y in content["y"]} - set(range(len(ACTIONS))))
    if unknown:
        raise FileFormatError(
            path, f"action {unknown[0]}; expected 0 to {len(ACTIONS) - 1}: is it another data set?"
        )
    clips = list(zip(*map(content.get, _NEEDED), strict=True))
    for number, (pose, joints, action) in enumerate(counted(clips, "clips")):
        label = Label(
            id=f"humanact12-{number:04d}",
            source=HUMANACT12.name,
            origin=f"{path.name}, clip {number}",
            split="train",
            action=ACTIONS[int(action)],
            mirrored_action=ACTIONS[int(action)],
        )
        try:
            pose, joints = map(as_numbers, (pose, joints))
        except (ValueError, TypeError) as error:
            raise FileFormatError(path, f"clip {number} holds no numbers ({error})") from error
        shapes = pose.shape, joints.shape
        if pose.ndim and shapes == ((len(pose), 3 * SMPL_JOINTS), (len(pose), SMPL_JOINTS, 3)):
            yield PosedRecording(label, pose, joints[:, 0]).encode(hold)
        else:
            actual = f"poses {shapes[0]} and joints {shapes[1]}"
            yield Dropped(label.id, "clip", f"{actual}, expected (n, 72) and (n, {SMPL_JOINTS}, 3)")
