"""Long takes → pieces of 1 to 10 seconds; two pieces that touch → one.

Takes are cut at glitches and labels, and else where the body is stillest.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from latentmotion.data.clip import TaggedSentence
from latentmotion.data.quality import clean_spans
from latentmotion.data.recording import Label, Recording
from latentmotion.kinematics.skeleton import Joints

LONGEST = 196  # Frames of the longest piece: HumanML3D's longest features.
SHORTEST = 20  # Frames of the shortest piece: a second.
USUAL = 120  # Frames of a piece where nothing else decides.

# Trade-off between a still cut and a piece of usual length: a cut may be faster by this many
# m/s for every `USUAL` frames that it brings the length nearer to `USUAL`.
_STAY = 0.3

_SUBJECT = re.compile(
    r"(?:(?P<article>an?|the|this|one)\s+)?"
    r"(?P<who>(?:young |old |sim |stick )?(?:person|man|woman|human|figure|character|guy|boy|girl"
    r"|individual|subject|figurine)|someone|somebody|he|she)\s+(?:who\s+)?(?P<rest>(?P<verb>\w+).*)",
    re.IGNORECASE | re.DOTALL,
)
_NOT_A_VERB = frozenset(("is", "was", "has", "his", "across", "towards", "forwards", "backwards"))


def pieces(
    joints: Joints,
    fps: float,
    spans: Sequence[tuple[int, int]] | None = None,
    cuts: Sequence[int] = (),
) -> Iterator[tuple[int, int]]:
    """Yields the pieces of a take, as first frame and one past the last.

    Args:
        joints: Joint positions, meters.
        fps: Frames per second.
        spans: Stretches to cut up, all of it by default; glitches are cut out of them.
        cuts: Frames where one action ends and another begins; pieces end there.
    """
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=-1).mean(1) * fps
    padded = np.pad(np.concatenate([speed[:1], speed]), 2, mode="edge")
    smooth_speed = np.convolve(np.nan_to_num(padded, nan=1e3), np.full(5, 0.2), "valid")
    bounds: list[tuple[int, int]] = []  # of clean stretches of one action
    for first, last in spans if spans is not None else [(0, len(joints))]:
        clean = clean_spans(joints[first:last], fps) if last - first >= SHORTEST else []
        for start, end in ((first + start, first + end) for start, end in clean):
            edges = [start]
            for cut in sorted(set(cuts)):  # those that leave no piece too short
                if edges[-1] + SHORTEST <= cut <= end - SHORTEST:
                    edges.append(cut)
            bounds += pairwise([*edges, end])
    for start, end in bounds:
        while end - start > LONGEST:
            # The rest must be long enough, and a piece no longer than the longest.
            low = start + 3 * SHORTEST
            high = min(start + LONGEST, end - SHORTEST)
            frames = np.arange(low, high + 1)
            cost = smooth_speed[frames] + _STAY * np.abs(frames - start - USUAL) / USUAL
            cut = int(frames[cost.argmin()])
            yield start, cut
            start = cut
        if end - start >= SHORTEST:
            yield start, end


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
    """Returns both as one recording, or None if their sentences do not describe two things.

    Args:
        first: A clip.
        second: The clip of the same recording that begins where the first ends.
    """
    before, after = first.label, second.label
    sentences = _join_all(before.sentences, after.sentences)
    if not sentences or before.sentences == after.sentences:
        return None
    label = Label(
        id=f"{before.id}+{after.id}",
        source=before.source,
        origin=f"{before.origin}+{after.origin}",
        split=before.split,
        sentences=sentences,
        mirrored_sentences=_join_all(before.mirrored_sentences, after.mirrored_sentences),
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


def _join_all(
    first: Sequence[TaggedSentence], second: Sequence[TaggedSentence]
) -> tuple[TaggedSentence, ...]:
    """Joins the sentences about whole clips, the n-th of one with the n-th of the other."""
    before, after = ([s.text for s in side if s.start == s.end == 0] for side in (first, second))
    if not (before and after):
        return ()
    count = max(len(before), len(after))
    pairs = [(before[n % len(before)], after[n % len(after)]) for n in range(count)]
    return tuple(TaggedSentence(join_sentences(*pair)) for pair in pairs)
