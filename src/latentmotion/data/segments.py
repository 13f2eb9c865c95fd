"""Long takes → pieces of 1 to 10 seconds; two pieces or motions → one.

Takes are cut at glitches and labels, and else where the body is stillest.

The second is turned and moved on the floor so that its first pose lies on the last of the first,
feet that stand above all. What remains of the difference in place and speed fades within half a
second ("inertialization", Bollo 2018, Game Developers Conference): per coordinate the quintic

    x(0) = x₀,  x'(0) = v₀,  x''(0) = 0,  x(T) = x'(T) = x''(T) = 0.

Bones then get their lengths back.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from latentmotion.data.clip import TaggedSentence
from latentmotion.data.quality import clean_spans
from latentmotion.data.recording import Label, Recording
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.representation.canonical import heading, turn
from latentmotion.representation.interface import Representation

LONGEST = 196
"""Frames of the longest piece: HumanML3D's longest features."""
SHORTEST = 20
"""Frames of the shortest piece: a second."""
USUAL = 120
"""Frames of a piece where nothing else decides."""

_STAY = 0.3
"""Meters per second by which a cut may be less still for every `USUAL` frames it is off."""

_SUBJECT = re.compile(
    r"(?:(?P<article>an?|the|this|one)\s+)?"
    r"(?P<who>(?:young |old |sim |stick )?(?:person|man|woman|human|figure|character|guy|boy|girl"
    r"|individual|subject|figurine)|someone|somebody|he|she)\s+(?:who\s+)?(?P<rest>(?P<verb>\w+).*)",
    re.IGNORECASE | re.DOTALL,
)
_NOT_A_VERB = frozenset(("is", "was", "has", "his", "across", "towards", "forwards", "backwards"))


def pieces(
    joints: Float[np.ndarray, "frames joints 3"],
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


Joints = Float[np.ndarray, "frames joints 3"]

_STANDING_HEIGHT, _STANDING_SPEED = 0.07, 0.4
"""Meters and meters per second below which a foot joint counts as standing at the seam."""

_STANDING_WEIGHT = 20.0
"""Weight of a standing foot joint beside other joints where motions are aligned."""


@dataclass(frozen=True)
class Seam:
    """How well two motions fit where they meet."""

    slide: float
    """Mean horizontal speed of foot joints on the floor in the transition, m/s."""
    jerk: float
    """Largest jerk of any joint in the transition, m/s³."""
    lowest: float
    """Height of the lowest joint in the transition, meters."""


def pose_descriptors(
    joints: Joints, fps: float, skeleton: Skeleton, frames: Int[np.ndarray, " chosen"]
) -> Float[np.ndarray, "chosen numbers"]:
    """Returns poses with their speeds as seen by the body, to compare by their distance.

    Speeds count as the distance covered in a sixth of a second; feet count twice.

    Args:
        joints: Positions, meters, y up, the floor at height 0.
        fps: Frames per second.
        skeleton: Skeleton of the joints.
        frames: Frames to describe.
    """
    velocity = np.gradient(joints, axis=0)[frames] * fps
    poses = joints[frames] - joints[frames, :1] * np.array([1.0, 0.0, 1.0])
    back = -np.asarray(heading(joints[frames], skeleton))[:, None]
    weights = np.ones(len(skeleton))
    weights[[*skeleton.left_foot, *skeleton.right_foot]] = 2.0
    blocks = [turn(poses, back), turn(velocity, back) / 6]
    rows = [(block * weights[:, None]).reshape(len(frames), -1) for block in blocks]
    return np.concatenate(rows, axis=1) / np.sqrt(len(skeleton))


def splice(
    first: Float[np.ndarray, "before joints 3"],
    second: Float[np.ndarray, "after joints 3"],
    seconds: float,
    representation: Representation,
) -> Float[np.ndarray, "total joints 3"]:
    """Returns the first motion up to its last frame, which is the second's first from then on.

    Args:
        first: Positions, meters; at least three frames.
        second: Positions; at least three frames.
        seconds: How long the transition takes.
        representation: Frame rate, skeleton and the lengths of bones.

    Returns:
        `len(first) + len(second) - 1` frames; the first `len(first) - 1` are the first's own.
    """
    fps, skeleton = representation.fps, representation.skeleton
    first, second = first.astype(np.float64), second.astype(np.float64)
    second = _aligned(first, second, fps, skeleton)
    offset = first[-1] - second[0]
    speed = _speed(first, -1) - _speed(second, 0)
    frames = min(round(seconds * fps), len(second) - 1)
    s = (np.arange(frames) / frames)[:, None, None]
    from_offset = 1 - 10 * s**3 + 15 * s**4 - 6 * s**5
    from_speed = s - 6 * s**3 + 8 * s**4 - 3 * s**5
    fading = offset * from_offset + speed * frames * from_speed
    second = second.copy()
    second[: len(fading)] += fading
    second[: len(fading)] = representation.retarget(second[: len(fading)])
    return np.concatenate([first[:-1], second])


def seam_of(joints: Joints, seam: int, fps: float, skeleton: Skeleton, frames: int) -> Seam:
    """Measures a transition that begins at frame `seam` and takes `frames`."""
    window = joints[max(seam - 2, 0) : seam + frames + 2]
    feet = window[:, [*skeleton.left_foot, *skeleton.right_foot]]
    steps = np.linalg.norm(np.diff(feet[..., ::2], axis=0), axis=-1) * fps
    low = np.maximum(feet[1:, :, 1], feet[:-1, :, 1]) < _STANDING_HEIGHT
    still = low & (np.abs(np.diff(feet[..., 1], axis=0)) * fps < _STANDING_SPEED)
    slide = float(steps[still].mean()) if still.any() else 0.0
    jerk = np.linalg.norm(np.diff(window, n=3, axis=0), axis=-1).max() * fps**3
    return Seam(slide, float(jerk), float(window[..., 1].min()))


def _aligned(
    first: Float[np.ndarray, "before joints 3"],
    second: Float[np.ndarray, "after joints 3"],
    fps: float,
    skeleton: Skeleton,
) -> Float[np.ndarray, "after joints 3"]:
    """Turns and moves the second so that its first pose lies on the first's last one."""
    goal, pose = first[-1], second[0]
    weights = np.ones(len(skeleton))
    for joint in (*skeleton.left_foot, *skeleton.right_foot):
        speeds = [np.linalg.norm(_speed(m, n)[joint]) * fps for m, n in ((first, -1), (second, 0))]
        low = max(goal[joint, 1], pose[joint, 1]) < _STANDING_HEIGHT
        if low and max(speeds) < _STANDING_SPEED:
            weights[joint] = _STANDING_WEIGHT
    weights /= weights.sum()
    centers = [weights @ joints for joints in (goal, pose)]
    (ax, _, az), (bx, _, bz) = (
        (joints - c).T for joints, c in zip((goal, pose), centers, strict=True)
    )
    angle = np.arctan2(weights @ (ax * bz - az * bx), weights @ (ax * bx + az * bz))
    move = centers[0] - turn(centers[1], angle)
    return turn(second, angle) + move * np.array([1.0, 0.0, 1.0])


def _speed(joints: Joints, frame: int) -> Float[np.ndarray, "joints 3"]:
    """Returns the step to the next frame at the start, from the one before at the end."""
    return joints[1] - joints[0] if frame == 0 else joints[-1] - joints[-2]
