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

from latentmotion.data.clip import Source, Split, TaggedSentence, mirror_words
from latentmotion.data.recording import (
    FPS,
    Dropped,
    FileGroup,
    Label,
    Recording,
    files_below,
    in_groups,
    joints_at,
)
from latentmotion.errors import DataError, FileFormatError
from latentmotion.formats.asf_amc import read_asf_amc
from latentmotion.progress import counted

HDM05 = Source(
    name="hdm05",
    license="CC BY-SA 3.0 Unported",
    credit=(
        "M. Müller, T. Röder, M. Clausen, B. Eberhardt, B. Krüger, A. Weber: Documentation Mocap "
        "Database HDM05, Universität Bonn, CG-2007-2"
    ),
    url="http://resources.mpi-inf.mpg.de/HDM05",
)

TEST_ACTOR = "tr"

_NAME = re.compile(r"HDM_(?P<actor>[a-z]+)_(?P<action>\w+)_(?P<number>\d+)_(?P<fps>\d+)$")


@dataclass(frozen=True)
class ActionClass:
    """One class of HDM05."""

    mirrored: str
    """Label of its mirror image, as HDM05 names or would name it."""
    sentences: tuple[str, ...]
    """Captions that an observer would write."""


CLASSES = {
    "depositFloorR": ActionClass(
        "depositFloorL",
        (
            "a person bends down and puts something on the floor with the right hand.",
            "someone leans over, places an object on the ground with their right hand and rises.",
            "a person reaches down to the floor with their right arm, then stands up again.",
        ),
    ),
    "elbowToKnee1RepsLelbowStart": ActionClass(
        "elbowToKnee1RepsRelbowStart",
        (
            "a person touches the right knee with the left elbow.",
            "someone lifts the right knee and brings the left elbow down to it.",
            "a standing person does one crunch, left elbow to right knee.",
        ),
    ),
    "grabHighR": ActionClass(
        "grabHighL",
        (
            "a person reaches up high and grabs something with the right hand.",
            "someone stretches the right arm up to take an object from a high shelf.",
            "a person raises their right hand above the head, grabs something and lowers the arm.",
        ),
    ),
    "hopBothLegs1hops": ActionClass(
        "hopBothLegs1hops",
        (
            "a person hops forward once on both legs.",
            "someone makes one short jump with both feet.",
            "a person jumps forward with both feet together.",
        ),
    ),
    "jogLeftCircle4StepsRstart": ActionClass(
        "jogRightCircle4StepsLstart",
        (
            "a person jogs along a curve to the left.",
            "someone runs slowly in a circle to the left.",
            "a person jogs four steps in a counterclockwise circle.",
        ),
    ),
    "kickLFront1Reps": ActionClass(
        "kickRFront1Reps",
        (
            "a person kicks forward with the left foot.",
            "someone does a front kick with their left leg.",
            "a person lifts the left leg and kicks something in front of them.",
        ),
    ),
    "lieDownFloor": ActionClass(
        "lieDownFloor",
        (
            "a person lies down on the floor.",
            "someone gets down to the ground and lies on it.",
            "a standing person lowers themselves to the floor and lies down.",
        ),
    ),
    "rotateArmsBothBackward1Reps": ActionClass(
        "rotateArmsBothBackward1Reps",
        (
            "a person rotates both arms backward once.",
            "someone swings both straight arms backwards in a big circle.",
            "a person circles both arms back around the shoulders.",
        ),
    ),
    "sneak2StepsLStart": ActionClass(
        "sneak2StepsRStart",
        (
            "a person sneaks forward, starting with the left foot.",
            "someone creeps forward carefully with two slow steps, left foot first.",
            "a person tiptoes forward quietly in a crouch.",
        ),
    ),
    "squat1Reps": ActionClass(
        "squat1Reps",
        (
            "a person squats down and stands up again.",
            "someone does one squat with the arms held out.",
            "a person bends the knees deeply, then straightens up.",
        ),
    ),
    "throwBasketball": ActionClass(
        "throwBasketball",
        (
            "a person throws a basketball.",
            "someone shoots a basketball up at the hoop.",
            "a person pushes a ball up and forward over the head.",
        ),
    ),
}
"""The classes whose clips are known to be here; clips of other classes get their label only."""


def hdm05_groups(folder: Path, size: int | None = None) -> list[FileGroup]:
    """Returns the clips below a folder in groups.

    Args:
        folder: Folder of the files, at any depth.
        size: Clips in a group; by default there is one group.

    Raises:
        DataError: There is no such folder, or no clip in it.
    """
    groups = in_groups(find_clips(folder), size)
    return [FileGroup(tuple(paths), partial(_read, paths)) for paths in groups]


def _read(paths: Sequence[Path]) -> Iterator[Recording | Dropped]:
    for path in counted(paths, "clips"):
        match = _NAME.match(path.stem)
        assert match is not None
        action, rate = match["action"], float(match["fps"])
        try:
            joints = joints_at(read_asf_amc(path, fps=rate), FPS, rate)
        except (FileFormatError, DataError) as error:
            yield Dropped(path.stem, "clip", str(error))
            continue
        action_class = CLASSES.get(action, ActionClass(action, ()))
        label = Label(
            id=path.stem,
            source=HDM05.name,
            origin=path.name,
            split=split_of(path.stem, match["actor"]),
            sentences=tuple(TaggedSentence(text) for text in action_class.sentences),
            mirrored_sentences=tuple(
                TaggedSentence(mirror_words(text)) for text in action_class.sentences
            ),
            action=action,
            mirrored_action=action_class.mirrored,
        )
        yield Recording(label, joints)


def find_clips(folder: Path) -> list[Path]:
    """Returns HDM05's cut clips below a folder.

    Raises:
        DataError: There is no such folder, or no clip in it.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; it should hold HDM05's clips, from {HDM05.url}")
    paths = [path for path in files_below(folder, [".amc"]) if _NAME.match(path.stem)]
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
