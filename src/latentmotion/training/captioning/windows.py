"""Joints and captions → windows of a motion with sentences that hold for each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.language.reading import claims_of
from latentmotion.measure.facts import Description
from latentmotion.measure.reported_acts import acts_of
from latentmotion.measure.scene import describe
from latentmotion.ranking.agreement import check
from latentmotion.training.captioning.sentences import sentences

Row = tuple[str, int, int]
"""A sentence, the first frame that it describes, and one past the last."""

NEARLY_ALL = 0.8
"""Share of a caption's frames that counts as all of them."""

LONG_ENOUGH = 2.5
"""Seconds in which a repeating movement can be recognized."""

_REPEATING = re.compile(
    r"\b(?:danc|box(?:es|ing)|fight|karate|martial|swim|dribbl|exercis|play|wash|wip|stir|mop|sweep"
    r"|conduct|direct|juggl|swing(?:s|ing) (?:his|her|their|both|the)|sway|laugh|talk|row|paddl"
    r"|cycl|skat|march|jumping jack|stretch|practic|pretend|imitat"
    r"|act(?:s|ing)|wander|pac(?:es|ing)"
    r"|limp|stagger|sneak|strut|drum|guitar|violin|chop|saw|hammer"
    r"|cheer|protest|gestur)"
)
_CLAUSES = re.compile(r",|;|\. |\bthen\b|\band\b|\bbefore\b|\bafter\b|\bfollowed by\b|\bwhile\b")


@dataclass(frozen=True)
class Windows:
    """Number and length of the windows of a motion, and the number of their sentences."""

    count: int = 3
    """Windows per motion."""
    shortest: int = 20
    """Frames of the shortest window."""
    longest: int = 196
    """Frames of the longest window."""
    sentences: int = 2
    """Measured sentences per window."""
    whole: int = 2
    """Measured sentences about the whole motion."""
    acts: int = 0
    """Most acts that a window may show; zero is any number."""


def caption_windows(
    joints: Float[np.ndarray, "frames 22 3"],
    captions: Sequence[Row],
    generator: np.random.Generator,
    windows: Windows = Windows(),
) -> list[Row]:
    """Returns sentences about a motion and about windows of it.

    Args:
        joints: As `describe` takes them.
        captions: Captions that it already has; these rows are not repeated.
        generator: Draws windows and wording.
        windows: Number and length of the windows.
    """
    frames = len(joints)
    rows: list[Row] = []
    if frames <= windows.longest and windows.whole:
        whole = describe(joints)
        rows += [(text, 0, frames) for text in sentences(whole, generator, count=windows.whole)]
    descriptions: dict[tuple[int, int], Description] = {}
    for start, end in draw_windows(frames, generator, windows):
        window = describe(joints[start:end])
        if windows.acts and len(acts_of(window)) > windows.acts:
            continue
        texts = sentences(window, generator, count=windows.sentences)
        for text, first, last in captions:
            if first <= start and end <= last and text not in texts:
                if (first, last) not in descriptions:
                    descriptions[first, last] = describe(joints[first:last])
                if holds(text, descriptions[first, last], window):
                    texts.append(text)
        rows += [(text, start, end) for text in texts]
    return rows


def draw_windows(
    frames: int, generator: np.random.Generator, windows: Windows
) -> list[tuple[int, int]]:
    """Draws different windows; the logarithm of their length is uniform."""
    longest = min(windows.longest, frames)
    if frames < 1.25 * windows.shortest:
        return []
    drawn: list[tuple[int, int]] = []
    for _ in range(windows.count):
        low, high = np.log(windows.shortest), np.log(longest)
        length = min(int(np.exp(generator.uniform(low, high)) + 0.5), longest)
        start = int(generator.integers(frames - length + 1))
        if (start, start + length) not in drawn and length < frames:
            drawn.append((start, start + length))
    return drawn


def holds(caption: str, whole: Description, part: Description) -> bool:
    """Says whether a caption of a motion is true of a part of it.

    Everything that the motion is found to do must be found in the part as well, with side, count
    and order. Words that cannot be measured are taken to hold if they describe a movement that
    repeats and the part is long enough, or if the part is nearly all of the motion.

    Args:
        caption: The sentence.
        whole: Description of the frames that the sentence is about.
        part: Description of some of them.
    """
    claims = claims_of(caption)
    of_whole, of_part = check(claims, whole), check(claims, part)
    if of_part.verdict == "contradicts":
        return False
    pairs = list(zip(of_whole.verdicts, of_part.verdicts, strict=True))
    if any(before == "agrees" and now != "agrees" for before, now in pairs):
        return False
    if part.frames >= NEARLY_ALL * whole.frames:
        return True
    if any(now != "agrees" for _, now in pairs):
        return False
    long_enough = part.seconds >= LONG_ENOUGH
    return all(
        long_enough if _REPEATING.search(clause) else len(clause.split()) < 3 or claims_of(clause)
        for clause in _CLAUSES.split(caption.lower())
    )
