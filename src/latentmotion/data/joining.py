"""Two clips that touch in one recording → one longer clip, captioned "A, then B"."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from latentmotion.data.captions import TaggedSentence
from latentmotion.data.recording import Label, Recording
from latentmotion.data.segments import LONGEST

_SUBJECT = re.compile(
    r"(?:(?P<article>an?|the|this|one)\s+)?"
    r"(?P<who>(?:young |old |sim |stick )?(?:person|man|woman|human|figure|character|guy|boy|girl"
    r"|individual|subject|figurine)|someone|somebody|he|she)\s+(?:who\s+)?(?P<rest>(?P<verb>\w+).*)",
    re.IGNORECASE | re.DOTALL,
)
_NOT_A_VERB = frozenset(("is", "was", "has", "his", "across", "towards", "forwards", "backwards"))


def touching(clips: Sequence[tuple[int, int, Recording]]) -> Iterator[Recording]:
    """Yields every two train clips that touch as one, where both have sentences that differ.

    Args:
        clips: First frame in the recording, one past the last, and the clip.
    """
    for (_, end, first), (start, _, second) in pairwise(sorted(clips, key=lambda clip: clip[:2])):
        both_train = first.label.split == second.label.split == "train"
        short = len(first.joints) + len(second.joints) <= LONGEST
        if start == end and both_train and short and (both := joined(first, second)):
            yield both


def joined(first: Recording, second: Recording) -> Recording | None:
    """Returns both as one recording, or None if they have no sentences that tell two things.

    Args:
        first: A clip.
        second: The clip of the same recording that begins where the first ends.
    """
    ours, theirs = first.label, second.label
    sentences = _pairs(ours.sentences, theirs.sentences)
    if not sentences or ours.sentences == theirs.sentences:
        return None
    label = Label(
        id=f"{ours.id}+{theirs.id}",
        source=ours.source,
        origin=f"{ours.origin}+{theirs.origin}",
        split=ours.split,
        sentences=sentences,
        mirrored_sentences=_pairs(ours.mirrored_sentences, theirs.mirrored_sentences),
    )
    return Recording(label, np.concatenate([first.joints, second.joints]))


def join_sentences(first: str, second: str) -> str:
    """Returns one sentence that says both, in this order.

    The second one's subject goes if a verb follows that agrees with any subject: "a person waves"
    and "he walks away" make "a person waves, then walks away". Otherwise both keep theirs: "a
    person waves. then the person is walking".
    """
    before, after = first.strip().rstrip(" .,;"), second.strip()
    match, start = _SUBJECT.match(after), _SUBJECT.match(before)
    if match is None:
        return f"{before}. then {after}"
    verb = match["verb"].lower()
    if start and verb.endswith("s") and not verb.endswith("ss") and verb not in _NOT_A_VERB:
        return f"{before}, then {match['rest']}"
    who = match["who"].lower()
    named = who if who in ("he", "she") else f"the {who.replace('someone', 'person')}"
    return f"{before}. then {named.replace('somebody', 'person')} {match['rest']}"


def _pairs(
    first: Sequence[TaggedSentence], second: Sequence[TaggedSentence]
) -> tuple[TaggedSentence, ...]:
    """Joins the sentences that tell of a whole clip, the n-th of one with the n-th of the other."""
    ours, theirs = ([s.text for s in side if s.start == s.end == 0] for side in (first, second))
    if not (ours and theirs):
        return ()
    count = max(len(ours), len(theirs))
    pairs = [(ours[n % len(ours)], theirs[n % len(theirs)]) for n in range(count)]
    return tuple(TaggedSentence(join_sentences(*pair)) for pair in pairs)
