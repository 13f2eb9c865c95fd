"""The ceiling: real motions, and what people's captions claim of them, by the same checks.

People's captions are found by regular expressions (`captions.csv`), which read nothing but the
prompts' kind of claims; a caption counts once a check. Annotators err and tell a part of a clip
alone, so that the figures are below 100 % even where every check is right.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files

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
    """Name of the clip."""
    caption: str
    """The sentence."""
    group: str
    """Group of the claim."""
    check: Check
    """The claim."""
    joints: Joints
    """The motion."""


def patterns() -> tuple[Pattern, ...]:
    """Returns the claims that are looked for."""
    text = (
        files("latentmotion.evaluation.instructions")
        .joinpath("captions.csv")
        .read_text(encoding="utf-8")
    )
    return tuple(
        Pattern(row["group"], re.compile(row["pattern"]), parse(row["check"]))
        for row in csv.DictReader(text.splitlines())
    )


def claimed(dataset: Dataset, split: str) -> list[Claimed]:
    """Returns the real motions of a split whose captions claim what prompts ask for.

    A claim that several captions make of the same frames is one. Where people's captions are tagged
    with parts of speech, as HumanML3D's are, those without tags (names of classes, rules) are
    left out.

    Raises:
        DataError: No caption of the split claims any of it.
    """
    known, clips = patterns(), dataset.clips(split)
    tagged = any(caption.tokens for clip in clips for caption in clip.captions)
    found = [one for clip in clips for one in _of_clip(dataset, clip, known, tagged)]
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
    for caption in (one for one in clip.captions if one.tokens or not tagged):
        text = caption.text.lower()
        for pattern in known:
            key = (str(pattern.check), caption.start_frame, caption.end_frame)
            if key in seen or _NEGATED.search(text) or not pattern.words.search(text):
                continue
            seen.add(key)
            if not len(joints):
                joints = dataset.representation.decode(dataset.features(clip))
            part = joints[caption.start_frame : caption.end_frame]
            if len(part) >= 8:
                yield Claimed(clip.id, caption.text, pattern.group, pattern.check, part)
