"""The ceiling: real motions, and what people's captions claim of them, by the same checks.

Captions are read by regular expressions (`captions.csv`), and so are labels of actions that name
sides and counts as HDM05's do (`labels.csv`); a caption counts once a check. That somebody stops is
not looked for: people say it where a clip ends. Annotators err and tell of a part of a clip alone,
so that the figures are below 100 % even where every check is right.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from typing import Literal

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError
from latentmotion.evaluation.instructions.expressions import Check, parse

Joints = Float[np.ndarray, "_ 22 3"]

_NEGATED = re.compile(r"\b(without|not|no|doesn't|never|or|as if|like)\b")


@dataclass(frozen=True)
class Pattern:
    """A claim that captions make."""

    group: str
    """Group of instructions that it belongs to."""
    words: re.Pattern[str]
    """What is looked for in a caption of small letters."""
    check: Check
    """What the motion must do then."""


@dataclass(frozen=True, eq=False)
class Claimed:
    """A real motion of which a caption claims something."""

    clip: str
    """Name of the clip, or its label."""
    caption: str
    """The sentence; the clip's name where a label claims it."""
    group: str
    """Group of the claim."""
    check: Check
    """The claim."""
    joints: Joints
    """The motion."""


def patterns(of: Literal["captions", "labels"]) -> tuple[Pattern, ...]:
    """Returns the claims that are looked for."""
    table = files("latentmotion.evaluation.instructions").joinpath(f"{of}.csv")
    return tuple(
        Pattern(row["group"], re.compile(row["pattern"]), parse(row["check"]))
        for row in csv.DictReader(table.read_text(encoding="utf-8").splitlines())
    )


def claimed(dataset: Dataset, split: str) -> list[Claimed]:
    """Returns the real motions of a split whose captions claim what prompts ask for.

    A claim that several captions make of the same frames is one. Where people's captions are tagged
    with parts of speech, as HumanML3D's are, those without tags (names of classes, rules) are
    left out.

    Raises:
        DataError: No caption of the split claims any of it.
    """
    known, clips = patterns("captions"), dataset.clips(split)
    tagged = any(caption.tokens for clip in clips for caption in clip.captions)
    found = [one for clip in clips for one in _of_clip(dataset, clip, known, tagged)]
    found += [one for clip in clips for one in _of_label(dataset, clip, patterns("labels"))]
    if not found:
        raise DataError(
            f"{dataset.folder}: no caption of the {split} split claims what can be checked; "
            "leave --data out"
        )
    return found


def _of_clip(
    dataset: Dataset, clip: Clip, known: tuple[Pattern, ...], tagged: bool
) -> Iterator[Claimed]:
    seen: set[tuple[str, int, int]] = set()
    joints: Joints = np.zeros((0, 22, 3))
    # Of labeled clips the label tells; their captions are made from it.
    written = () if clip.action else clip.captions
    for caption in (one for one in written if one.tokens or not tagged):
        text = caption.text.lower()
        for pattern in known:
            key = (str(pattern.check), caption.start_frame, caption.end_frame)
            if key in seen or not _claims(text, pattern):
                continue
            seen.add(key)
            if not len(joints):
                joints = dataset.representation.decode(dataset.features(clip))
            part = joints[caption.start_frame : caption.end_frame]
            if len(part) >= 8:
                yield Claimed(clip.id, caption.text, pattern.group, pattern.check, part)


def _of_label(dataset: Dataset, clip: Clip, known: tuple[Pattern, ...]) -> Iterator[Claimed]:
    """Clips of one label resemble each other, and count as takes of it."""
    fitting = [pattern for pattern in known if clip.action and pattern.words.match(clip.action)]
    if fitting and clip.frames >= 8:
        joints = dataset.representation.decode(dataset.features(clip))
        for pattern in fitting:
            yield Claimed(str(clip.action), clip.id, pattern.group, pattern.check, joints)


def _claims(text: str, pattern: Pattern) -> bool:
    """A caption of both sides tells of more than the one side that prompts ask for."""
    if _NEGATED.search(text) or not pattern.words.search(text):
        return False
    both = re.search(r"\bleft\b", text) and re.search(r"\bright\b", text)
    return not (both and pattern.group == "side")
