"""HDM05: short clips of one action each → recordings with an action label and plain sentences.

Clips are called `HDM_ACTOR_CLASS_NNN_120.amc`, 120 frames per second. HDM05 has no splits; here
the actor `tr` is the test split and every tenth clip of the others, by hash, is validation.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from latentmotion.data import recording
from latentmotion.data.clip import Split, TaggedSentence, mirror_sentence
from latentmotion.data.sources import LABELS, OWNERS
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.progress import counted

HDM05 = OWNERS["hdm05"]

TEST_ACTOR = "tr"

_NAME = re.compile(r"HDM_(?P<actor>[a-z]+)_(?P<action>\w+)_(?P<number>\d+)_(?P<fps>\d+)$")


@dataclass(frozen=True)
class ActionClass:
    """One class of HDM05."""

    mirrored: str  # Label of its mirror image, as HDM05 names or would name it.
    sentences: tuple[str, ...]  # Captions that an observer would write.


# The classes whose clips are known to be here; clips of other classes get their label only.
CLASSES = {
    name: ActionClass(row.get("mirrored", name), tuple(row["sentences"]))
    for name, row in LABELS["hdm05"].items()
}


def hdm05_groups(folder: Path, size: int | None = None) -> list[recording.FileGroup]:
    """Returns the clips below a folder in groups.

    Args:
        folder: Folder of the files, at any depth.
        size: Clips in a group; by default there is one group.

    Raises:
        DataError: There is no such folder, or no clip in it.
    """
    groups = recording.in_groups(find_clips(folder), size)
    return [recording.FileGroup(tuple(paths), partial(_read, paths)) for paths in groups]


def _read(paths: Sequence[Path]) -> Iterator[recording.Recording | recording.Dropped]:
    for path in counted(paths, "clips"):
        match = _NAME.match(path.stem)
        assert match is not None
        action, rate = match["action"], float(match["fps"])
        try:
            joints = recording.joints_at(read_asf_amc(path, fps=rate), recording.FPS, rate)
        except (FileFormatError, DataError) as error:
            yield recording.Dropped(path.stem, "clip", str(error))
            continue
        action_class = CLASSES.get(action, ActionClass(action, ()))
        sentences = tuple(map(TaggedSentence, action_class.sentences))
        label = recording.Label(
            id=path.stem,
            source=HDM05.name,
            origin=path.name,
            split=split_of(path.stem, match["actor"]),
            sentences=sentences,
            mirrored_sentences=tuple(map(mirror_sentence, sentences)),
            action=action,
            mirrored_action=action_class.mirrored,
        )
        yield recording.Recording(label, joints)


def find_clips(folder: Path) -> list[Path]:
    """Returns HDM05's cut clips below a folder.

    Raises:
        DataError: There is no such folder, or no clip in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold HDM05's clips, from {HDM05.url}")
    paths = [path for path in recording.files_below(folder, [".amc"]) if _NAME.match(path.stem)]
    if not paths:
        raise DataError(
            f"{folder}: expected cut clips HDM_ACTOR_CLASS_NNN_120.amc beside HDM_ACTOR.asf, "
            f"found none; get them from {HDM05.url}"
        )
    return paths


def split_of(name: str, actor: str) -> Split:
    """Returns the split of a clip, the same on every machine."""
    if actor == TEST_ACTOR:
        return "test"
    # One in ten (26 of 256), by a hash, so that more files never move one to another split.
    return "val" if hashlib.sha256(name.encode()).digest()[0] < 26 else "train"
