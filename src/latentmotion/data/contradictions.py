"""Captions that the motions contradict: found by the describer, taken out of the train split."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from latentmotion.data.dataset import Dataset
from latentmotion.data.manifest import CaptionRow, StoredClip
from latentmotion.data.recording import Dropped
from latentmotion.describe.agreement import check
from latentmotion.describe.reading import describe

_FEWEST = 4
"""Frames of the shortest motion that can be described."""

Joints = Float[np.ndarray, "frames 22 3"]


def contradiction(caption: str, joints: Joints) -> str:
    """Returns what a motion does that a caption of it denies; empty where there is nothing.

    Args:
        caption: A sentence, or the name of an action.
        joints: As `describe` takes them.
    """
    if len(joints) < _FEWEST:
        return ""
    found = check(caption, describe(joints))
    pairs = zip(found.verdicts, found.reasons, strict=True)
    return "; ".join(reason for verdict, reason in pairs if verdict == "contradicts")


def without_contradicted(dataset: Dataset) -> tuple[Dataset, tuple[Dropped, ...]]:
    """Takes captions that the motion contradicts out of the train split.

    Val and test keep the captions that people wrote.

    Returns:
        The data set with the other captions, and what was taken out, with the reason.
    """
    dropped: list[Dropped] = []
    clips = []
    for clip in dataset.manifest.clips:
        if clip.split == "train":
            captions = _kept(dataset, clip, False, dropped)
            mirrored = _kept(dataset, clip, True, dropped)
            clip = replace(clip, captions=captions, mirrored_captions=mirrored)
        clips.append(clip)
    manifest = replace(dataset.manifest, clips=tuple(clips))
    return replace(dataset, manifest=manifest), tuple(dropped)


def _kept(
    dataset: Dataset, clip: StoredClip, mirrored: bool, dropped: list[Dropped]
) -> tuple[CaptionRow, ...]:
    """Returns the captions of one side that hold, and adds the others to those dropped."""
    rows = clip.mirrored_captions if mirrored else clip.captions
    if not rows:
        return rows
    joints = dataset.representation.decode(dataset.features(clip.clip(mirrored)))
    kept = []
    for row in rows:
        text, start, end, _ = row
        if reason := contradiction(text, joints[start:end]):
            side = "mirrored: " if mirrored else ""
            dropped.append(Dropped(clip.id, "caption", f"{side}{text!r}, but {reason}"))
        else:
            kept.append(row)
    return tuple(kept)
