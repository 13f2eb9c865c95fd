"""Whether a clip's caption still holds for a part of the clip."""

from __future__ import annotations

import re

from latentmotion.describe.agreement import check
from latentmotion.describe.claims import claims_of
from latentmotion.describe.facts import Description

NEARLY_ALL = 0.8
"""Part of a caption's span that is as good as all of it."""

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


def holds(caption: str, whole: Description, part: Description) -> bool:
    """Says whether a caption of a motion is true of a part of it.

    All that the motion is found to do must be found in the part as well, with side, count and
    order. Words that cannot be measured are taken to hold if they tell of a movement that repeats
    and the part is long enough, or if the part is nearly all of the motion.

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
    return all(_is_known(clause, part) for clause in _CLAUSES.split(caption.lower()))


def _is_known(clause: str, part: Description) -> bool:
    """Says whether a clause is measured, repeats, or says too little to matter."""
    words = clause.split()
    if _REPEATING.search(clause):
        return part.seconds >= LONG_ENOUGH
    return len(words) < 3 or bool(claims_of(clause))
