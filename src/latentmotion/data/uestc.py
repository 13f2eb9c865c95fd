"""UESTC with the poses that VIBE estimated, as ACTOR distributes it.

    info/names.txt              one video a line: aACTION_dVIEW_pSUBJECT_cSIDE_color.avi
    info/num_frames_min.txt     its frames, a line each
    info/action_classes.txt     names of the 40 actions
    vibe_cache_refined.pkl      lists by video: pose (frames, 72), joints3d (frames, 49, 3),
                                orig_cam (frames, 4): scales x and y, shifts x and y
    globtrans_usez.pkl          optional, lists by video: the camera's shifts in 3D (frames, 3)

Views of the second side are turned to the front, by 45° each; its view 8 circles the subject and
is left out. VIBE's camera is a weak perspective: a person that it scales by s is 2f / (w s) away.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.data.captions import mirror_words
from latentmotion.data.clip import Source, Split
from latentmotion.data.recording import Dropped, EncodedRecording, Label
from latentmotion.data.smpl_poses import PosedRecording
from latentmotion.errors import DataError, FileFormatError
from latentmotion.kinematics.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from latentmotion.storage import pickles

UESTC = Source(
    name="uestc",
    license="research only: the terms of the UESTC RGB-D database; poses are of the SMPL model",
    credit=(
        "Y. Ji et al.: A Large-scale RGB-D Database for Arbitrary-view Human Action Recognition, "
        "ACM MM 2018; poses by VIBE, refined by M. Petrovich et al.: ACTOR, ICCV 2021"
    ),
    url="https://github.com/Mathux/ACTOR",
)

TRAIN_SUBJECTS = frozenset(
    (
        *(1, 2, 6, 12, 13, 16, 21, 24, 28, 29, 30, 31, 33, 35, 39, 41, 42, 45, 47, 50, 52, 54, 55),
        *(57, 59, 61, 63, 64, 67, 69, 70, 71, 73, 77, 81, 84, 86, 87, 88, 90, 91, 93, 96, 99, 102),
        *(103, 104, 107, 108, 112, 113),
    )
)
"""51 of the 118 subjects; the others are the test split."""

SHORTEST = 45
"""Frames that a training clip has at least; the test split has them all."""

FOCAL, IMAGE = 500.0, 540.0
"""Focal length and width of the image in which VIBE's camera is told, pixels."""

_MID_HIP = 8
"""The joint of VIBE's 49 whose way is the root's."""

POSES, SHIFTS = "vibe_cache_refined.pkl", "globtrans_usez.pkl"
NAMES, FRAMES, ACTIONS = (
    f"info/{name}.txt" for name in ("names", "num_frames_min", "action_classes")
)
_KEYS = ("pose", "joints3d", "orig_cam")
_VIDEO = re.compile(r"a(\d+)_d(\d+)_p(\d+)_c(\d+)_")


@dataclass(frozen=True)
class Video:
    """What a video's name says."""

    action: int
    """Number of the action, from 0."""
    view: int
    """Which of the 8 directions around the subject, or 8 for a camera that circles it."""
    subject: int
    """Who moves."""
    side: int
    """1 for the camera in front; 2 for the other one."""

    @property
    def split(self) -> Split:
        """The part of the data it belongs to."""
        return "train" if self.subject in TRAIN_SUBJECTS else "test"

    @property
    def to_front(self) -> Float[np.ndarray, "3 3"]:
        """The turn about the vertical after which the subject faces the camera."""
        eighths = 0 if self.side == 1 else self.view
        return matrix_from_axis_angle(np.array([0.0, -eighths * np.pi / 4, 0.0]))


def uestc_recordings(folder: Path, hold: int) -> Iterator[EncodedRecording | Dropped]:
    """Yields every video.

    Args:
        folder: Where the files lie.
        hold: Frames up to which shorter clips keep still in their last one.

    Raises:
        DataError: The folder lacks something, or its files do not fit together.
        FileFormatError: A file is damaged.
    """
    names, frames, actions = (_lines(folder / name) for name in (NAMES, FRAMES, ACTIONS))
    poses = _poses(folder, len(names))
    shifts = _known_shifts(folder, len(names))
    if len(frames) != len(names) or not all(count.strip().isdigit() for count in frames):
        raise DataError(
            f"{folder / FRAMES}: expected {len(names)} lines as {NAMES} has, a number in each"
        )
    for number, name in enumerate(names):
        video = _video(folder, name, len(actions))
        pose, joints, camera = (np.asarray(poses[key][number]) for key in _KEYS)
        _check_shapes(folder, name, pose, joints, camera)
        shift = depth_shifts(camera) if shifts is None else shifts[number]
        label = _label(name, video, actions[video.action])
        count = min(int(frames[number]), len(pose))
        yield _recording(label, video, count, pose, joints[:, _MID_HIP], shift, hold)


def depth_shifts(camera: Float[np.ndarray, "frames 4"]) -> Float[np.ndarray, "frames 3"]:
    """Returns how a person moves by what VIBE's camera says, since the first frame, meters."""
    depth = 2 * FOCAL / (IMAGE * camera[:, 0])
    shifts = np.stack([camera[:, 2], camera[:, 3], depth], axis=-1)
    return shifts - shifts[:1]


def _recording(
    label: Label,
    video: Video,
    frames: int,
    pose: Float[np.ndarray, "all 72"],
    root: Float[np.ndarray, "all 3"],
    shift: Float[np.ndarray, "all 3"],
    hold: int,
) -> EncodedRecording | Dropped:
    if video.side != 1 and video.view == 8:
        return Dropped(label.id, "clip", "view 8 of side 2: the camera circles the subject")
    if video.split == "train" and frames < SHORTEST:
        return Dropped(label.id, "clip", f"{frames} frames, fewer than {SHORTEST}")
    turned = np.array(pose[:frames], dtype=np.float64)
    turned[:, :3] = axis_angle_from_matrix(video.to_front @ matrix_from_axis_angle(turned[:, :3]))
    way = (root[:frames] + shift[:frames]) @ video.to_front.T
    return PosedRecording(label, turned, way).encode(hold)


def _label(name: str, video: Video, action: str) -> Label:
    return Label(
        id=name.removesuffix("_color.avi"),
        source=UESTC.name,
        origin=name,
        split=video.split,
        action=action,
        mirrored_action=mirror_words(action),
    )


def _video(folder: Path, name: str, actions: int) -> Video:
    match = _VIDEO.match(name)
    video = Video(*map(int, match.groups())) if match else None
    if video is None or video.action >= actions or not 0 <= video.view <= 8:
        raise DataError(
            f"{folder / NAMES}: {name!r}; expected names like a0_d2_p013_c1_color.avi, with "
            f"actions below {actions}, of which {ACTIONS} has a line each"
        )
    return video


def _lines(path: Path) -> list[str]:
    if not path.is_file():
        raise DataError(
            f"no file {path}; the folder should hold {NAMES}, {FRAMES}, {ACTIONS} and "
            f"{POSES}, from {UESTC.url}"
        )
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path} cannot be read as text: {error}; download it again") from error


def _poses(folder: Path, videos: int) -> Mapping[str, Sequence[np.ndarray]]:
    path = folder / POSES
    content = pickles.load(path)
    found = ", ".join(map(str, content)) if isinstance(content, Mapping) else type(content).__name__
    if not isinstance(content, Mapping) or any(key not in content for key in _KEYS):
        raise FileFormatError(path, f"expected {', '.join(_KEYS)}, found {found}")
    for key in _KEYS:
        _check_count(path, key, content[key], videos)
    return content


def _known_shifts(folder: Path, videos: int) -> Sequence[np.ndarray] | None:
    path = folder / SHIFTS
    if not path.is_file():
        return None
    shifts = pickles.load(path)
    _check_count(path, "shifts", shifts, videos)
    return shifts


def _check_shapes(folder: Path, name: str, *arrays: np.ndarray) -> None:
    frames = len(arrays[0]) if arrays[0].ndim else 0
    found, expected = [a.shape for a in arrays], [(frames, 72), (frames, 49, 3), (frames, 4)]
    if found != expected:
        raise FileFormatError(
            folder / POSES, f"{name}: {', '.join(_KEYS)} of the shapes {found}, expected {expected}"
        )


def _check_count(path: Path, what: str, values: Any, videos: int) -> None:
    if len(values) != videos:
        raise FileFormatError(path, f"{what} of {len(values)} videos, {NAMES} has {videos}")
