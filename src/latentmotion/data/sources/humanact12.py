"""HumanAct12 with SMPL's poses, as ACTOR distributes it in one file, `humanact12poses.pkl`.

    poses      a list of (frames, 72) rotation vectors, one per clip
    joints3D   a list of (frames, 24, 3) joints, of which the root trajectory is used
    y          the action of each clip, 0 .. 11

There is one split, `train`, on which its models are measured too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from latentmotion.data.clip import Source
from latentmotion.data.recording import (
    SMPL_JOINTS,
    Dropped,
    EncodedRecording,
    Label,
    PosedRecording,
    as_numbers,
)
from latentmotion.errors import FileFormatError
from latentmotion.progress import counted
from latentmotion.storage import pickles

HUMANACT12 = Source(
    name="humanact12",
    license="research only: the terms of HumanAct12 and of PHSPD; poses are of the SMPL model",
    credit=(
        "C. Guo et al.: Action2Motion, ACM MM 2020; S. Zou et al.: 3D Human Shape Reconstruction "
        "from a Polarization Image, ECCV 2020; poses by M. Petrovich et al.: ACTOR, ICCV 2021"
    ),
    url="https://github.com/Mathux/ACTOR",
)

ACTIONS = (
    *("warm_up", "walk", "run", "jump", "drink", "lift_dumbbell", "sit", "eat"),
    *("turn steering wheel", "phone", "boxing", "throw"),
)
"""Its labels, in the order of their numbers; each is its own mirror image."""

_NEEDED = ("poses", "joints3D", "y")


def humanact12_recordings(path: Path, hold: int) -> Iterator[EncodedRecording | Dropped]:
    """Yields every clip.

    Args:
        path: The file.
        hold: Length in frames to which shorter clips are padded with their last frame.

    Raises:
        FileFormatError: The file cannot be read, or is laid out otherwise.
    """
    content = pickles.load(path)
    if not isinstance(content, Mapping) or any(key not in content for key in _NEEDED):
        is_mapping = isinstance(content, Mapping)
        actual = ", ".join(map(str, content)) if is_mapping else type(content).__name__
        raise FileFormatError(
            path, f"expected {', '.join(_NEEDED)} of humanact12poses.pkl, found {actual}"
        )
    for key in _NEEDED:
        values = content[key]
        is_array = isinstance(values, np.ndarray) and values.ndim > 0
        if not (is_array or isinstance(values, list | tuple)):
            actual = type(values).__name__
            raise FileFormatError(path, f"{key} is a {actual}, expected a list by clip")
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
