"""Ground truth of the benchmark: claims of real motions' captions, tested by the same checks.

Claims are found by regular expressions in captions (`captions.csv`) and in labels of actions that
name sides and counts, as HDM05's do (`labels.csv`); a caption counts once per check. Stops are not
searched, since people mention them where a clip ends. Annotators err and describe only parts of
clips, so that figures are below 100 % even if every check is right.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.data.instructions import Check, parse
from latentmotion.errors import DataError
from latentmotion.evaluation.instructions.motions import MIN_FRAMES, Joints
from latentmotion.evaluation.instructions.prompts import packaged_text

_NEGATED = re.compile(r"\b(without|not|no|doesn't|never|or|as if|like)\b")


@dataclass(frozen=True)
class Pattern:
    """A claim that captions can make."""

    group: str
    """Its group of instructions."""
    words: re.Pattern[str]
    """Expression in a lower-case caption."""
    check: Check
    """Check of the motion."""

    def is_in(self, text: str) -> bool:
        """Returns whether a caption makes the claim; one of both sides claims no single side."""
        if _NEGATED.search(text) or not self.words.search(text):
            return False
        both = re.search(r"\bleft\b", text) and re.search(r"\bright\b", text)
        return not (both and self.group == "side")


@dataclass(frozen=True, eq=False)
class CaptionClaim:
    """A real motion with a claim of its caption."""

    clip: str
    """Name of the clip, or its label if the label makes the claim."""
    caption: str
    """The caption, or the clip's name if the label makes the claim."""
    group: str
    """Group of the claim."""
    check: Check
    """Check of the motion."""
    joints: Joints
    """The motion."""


def patterns(of: Literal["captions", "labels"]) -> tuple[Pattern, ...]:
    """Returns the claims that are searched."""
    return tuple(
        Pattern(row["group"], re.compile(row["pattern"]), parse(row["check"]))
        for row in csv.DictReader(packaged_text(f"{of}.csv").splitlines())
    )


def claims_of(dataset: Dataset, split: str) -> list[CaptionClaim]:
    """Returns the real motions of a split whose captions claim what prompts ask for.

    A claim that several captions make of the same frames is one. If captions are tagged with parts
    of speech, as HumanML3D's are, those without tags (names of classes, rules) are left out.

    Raises:
        DataError: No caption of the split makes a claim.
    """
    clips = dataset.clips(split)
    tagged = any(caption.tokens for clip in clips for caption in clip.captions)
    known_claims = patterns("captions")
    claims = [
        claim for clip in clips for claim in caption_claims(dataset, clip, known_claims, tagged)
    ]
    # Clips of one label resemble each other, and count as takes of it.
    known_claims = patterns("labels")
    for clip in clips:
        fitting = [
            pattern for pattern in known_claims if clip.action and pattern.words.match(clip.action)
        ]
        if fitting and clip.frames >= MIN_FRAMES:
            joints = dataset.representation.decode(dataset.features(clip))
            label = str(clip.action)
            claims += [CaptionClaim(label, clip.id, p.group, p.check, joints) for p in fitting]
    if not claims:
        raise DataError(
            f"{dataset.folder}: no caption of the {split} split claims what can be checked; "
            "leave --data out"
        )
    return claims


def caption_claims(
    dataset: Dataset, clip: Clip, known_claims: Sequence[Pattern], tagged: bool
) -> Iterator[CaptionClaim]:
    """Yields the claims of a clip's captions.

    Args:
        dataset: Data set of the clip.
        clip: The clip.
        known_claims: Claims to search.
        tagged: Whether captions without parts of speech are left out.
    """
    counted: set[tuple[str, int, int]] = set()
    joints: Joints = np.zeros((0, 22, 3))
    # Captions of labeled clips are made from the label, which makes the claim.
    written = () if clip.action else clip.captions
    for caption in (item for item in written if item.tokens or not tagged):
        text = caption.text.lower()
        for pattern in known_claims:
            key = (str(pattern.check), caption.start_frame, caption.end_frame)
            if key in counted or not pattern.is_in(text):
                continue
            counted.add(key)
            if not len(joints):
                joints = dataset.representation.decode(dataset.features(clip))
            part = joints[caption.start_frame : caption.end_frame]
            if len(part) >= MIN_FRAMES:
                yield CaptionClaim(clip.id, caption.text, pattern.group, pattern.check, part)
