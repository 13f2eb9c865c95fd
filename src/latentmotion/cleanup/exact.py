"""Exact counts and turns: a motion does as often and turns as far as asked, where it nearly does.

Counts: two frames with like poses and speeds, and repetitions between them, bound a cycle. It is
left out where there are too many, and done again where there are too few; the path goes on from
where it is, in the direction that the body faces. Movements that look like half a repetition go.

Turns: the rotation that is missing is spread over the frames in which the pelvis turns the asked
way, in proportion to how fast it does, and the path bends with it.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, replace

import numpy as np
from jaxtyping import Float, Int

from latentmotion.kinematics.skeleton import BatchedJoints, Skeleton
from latentmotion.language.claims import Count, Turn
from latentmotion.measure.repetitions import COUNTED, Repetitions, repetitions
from latentmotion.motion import Motion
from latentmotion.representation.canonical import gaussian_smooth, turn
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.splicing import pose_descriptors, seam_of, splice

Joints = Float[np.ndarray, "frames 22 3"]

Pieces = list[tuple[int, int]]  # First and last frame of each piece of a motion, in their order.

Candidates = Sequence[Motion]  # Of which one may do an act as often as asked.

# Largest count that is made.
_MOST = 20

# Fewest and most frames of a motion that is made.
_FRAMES = (20, 196)

# Repetitions that always fit into it.
_SURELY = 3

# Seconds in which a cycle is joined.
_TRANSITION = 0.4

# Largest distance of the poses with their speeds at which a cycle begins and ends, meters.
_APART = 0.3

# Most that feet may slide in a transition on average, m/s, and a joint may jerk, m/s³.
_SLIDE, _JERK = 0.3, 1200.0

# Seconds before the first and after the last repetition in which pieces begin and end: what is
# farther away is another act.
_AROUND = 1.0

# Cycles that are tried, the nearest first.
_TRIES = 6

# Cost of another seam, meters.
_SEAM = 0.02

# Distance of poses that must not be joined, meters.
_FAR = 9.0

# Frames by which cycles differ that are tried.
_OTHER = 4


def exact_count(
    motion: Motion, cleaned: Motion, asked: Count
) -> Generator[Candidates, Candidates, Motion]:
    """Returns a motion that does an act as often as asked, cleaned up.

    Yields candidates and is sent them cleaned up, so that those of several motions can be together.
    It stays as it is where it does not do the act at all, where no two poses are near enough or
    the seam would not be smooth, and where it would get longer than the longest motion.

    Args:
        motion: The motion before it was cleaned up.
        cleaned: The motion, cleaned up.
        asked: What it should do.
    """
    fps, skeleton = HUMANML3D_FEATURES.fps, HUMANML3D_FEATURES.skeleton
    if (motion.skeleton.names, motion.fps) != (skeleton.names, fps) or len(motion) < _FRAMES[0]:
        return cleaned
    if asked.act not in COUNTED or not 1 <= asked.times <= _MOST:
        return cleaned
    joints = cleaned.joints.astype(np.float64)
    repeated = repetitions(joints, asked.act, asked.side)
    if repeated is None or not repeated.full:
        return cleaned
    if len(repeated.full) in asked.wanted and not repeated.weak:
        return cleaned
    raw, arrangements = motion.joints.astype(np.float64), _arrangements(joints, repeated, asked)
    # Where the first fails, to clean up all others takes little longer than another one.
    for some in (arrangements[:1], arrangements[1:]):
        spliced = [_spliced(raw, pieces) for pieces in some]
        candidates = yield [replace(motion, joints=np.float32(whole)) for whole, _ in spliced]
        for candidate, (_, seams) in zip(candidates, spliced, strict=True):
            joints = candidate.joints.astype(np.float64)
            fits = [seam_of(joints, s, fps, skeleton, round(_TRANSITION * fps)) for s in seams]
            if not all(fit.slide <= _SLIDE and fit.jerk <= _JERK for fit in fits):
                continue
            again = repetitions(joints, asked.act, asked.side)
            if again and not again.weak and len(again.full) in asked.wanted:
                about = {**asdict(asked), "made": len(repeated.full)}
                return replace(candidate, metadata={**candidate.metadata, "count": about})
    return cleaned


def _spliced(joints: Joints, pieces: Pieces) -> tuple[Float[np.ndarray, "spliced 22 3"], list[int]]:
    """Returns pieces of a motion one after another, and the frames after which they are joined."""
    (start, end), *others = pieces
    spliced, seams = joints[start : end + 1], []
    for first, last in others:
        seams.append(len(spliced) - 1)
        piece = joints[first : last + 1]
        spliced = splice(spliced, piece, _TRANSITION, HUMANML3D_FEATURES, fitted=False)
    return spliced, seams


def as_many_as_fit(
    motion: Motion, cleaned: Motion, asked: Count
) -> Generator[Candidates, Candidates, tuple[Motion, int]]:
    """Returns a motion with an exact count, or as near to it as the longest motion can be.

    Args:
        motion: As for `exact_count`; so are all further arguments.
        cleaned: The motion, cleaned up.
        asked: What it should do.

    Returns:
        The motion, and how many repetitions fit, zero where as many as are asked for would.
    """
    exact = yield from exact_count(motion, cleaned, asked)
    if asked.times <= _SURELY or asked.act not in COUNTED or exact is not cleaned:
        return exact, 0
    repeated = repetitions(exact.joints.astype(np.float64), asked.act, asked.side)
    full = repeated.full if repeated else ()
    if not full or motion.fps != HUMANML3D_FEATURES.fps:
        return exact, 0
    each = (full[-1].end - full[0].start) / len(full)
    fit = len(full) + int((_FRAMES[1] - len(exact)) / each)
    for times in (fit + 1, fit, fit - 1) if fit < asked.times else ():
        most = yield from exact_count(motion, cleaned, replace(asked, times=times))
        if most is not cleaned:
            return most, times
    return exact, len(full) if fit < asked.times else 0


def _arrangements(joints: Joints, found: Repetitions, asked: Count) -> list[Pieces]:
    """Returns pieces that show the act as often as asked in sequence, the nearest poses first.

    They are a start, a cycle so many times, and an end, without weak repetitions.
    """
    frames, final, all_of_them = np.arange(len(joints)), len(joints) - 1, len(found.full)
    moments = [*found.weak, *(frame for event in found.full for frame in (event.start, event.end))]
    around = round(_AROUND * HUMANML3D_FEATURES.fps)
    free = (frames >= max(2, min(moments) - around)) & (frames <= final - 3)
    free &= frames <= max(moments) + around
    for event in found.full if asked.act != "step" else ():  # one foot or the other always steps
        free[event.start + 1 : event.end] = False
    passed = _passed([0.5 * (event.start + event.end) for event in found.full], frames)
    weak = _passed(found.weak, frames)
    # The distance of every two poses with their speeds, as seen by the body, meters.
    poses = pose_descriptors(joints, HUMANML3D_FEATURES.fps, HUMANML3D_FEATURES.skeleton, frames)
    squares = (poses**2).sum(axis=1)
    apart = np.sqrt(np.maximum(squares[:, None] + squares - 2 * poses @ poses.T, 0))
    again = passed - passed[:, None]
    possible: list[tuple[float, Pieces]] = []
    for left in range(all_of_them + 1):
        ends = free & (weak == len(found.weak)) & (passed == all_of_them - left)
        closing = np.where((free & (weak == 0))[:, None] & ends, apart, _FAR)
        resumes, close = closing.argmin(axis=1), closing.min(axis=1)
        for times in range(asked.times + 1):
            counts = passed + times * again + left
            length = frames + times * (frames - frames[:, None]) + final - resumes
            good = (counts >= asked.wanted.start) & (counts < asked.wanted.stop)
            good &= (length >= _FRAMES[0]) & (length <= _FRAMES[1])
            good &= (again > 0) & free[:, None] if times else frames[:, None] == 0
            costs = np.where(good, close + times * apart, _FAR)
            for cost, first, last in _lowest(costs, _APART * (times + 1)):
                pieces = [(0, last), *[(first, last)] * times, (int(resumes[last]), final)]
                possible.append((cost + _SEAM * times, pieces))
    return [pieces for _, pieces in sorted(possible)[:_TRIES]]


def _lowest(
    costs: Float[np.ndarray, "frames frames"], most: float
) -> Iterator[tuple[float, int, int]]:
    """Yields some of the lowest costs with their row and column, none near another."""
    for _ in range(_TRIES // 2):
        row, column = (int(place) for place in np.unravel_index(costs.argmin(), costs.shape))
        if costs[row, column] > most:
            return
        yield float(costs[row, column]), row, column
        around = [slice(max(place - _OTHER, 0), place + _OTHER) for place in (row, column)]
        costs[around[0], around[1]] = _FAR


def _passed(
    middles: Sequence[float], frames: Int[np.ndarray, " frames"]
) -> Int[np.ndarray, " frames"]:
    """Returns how many of some moments are before each frame."""
    return (np.asarray(middles).reshape(-1, 1) < frames).sum(axis=0)


# Share of the degrees asked that a motion turns at least; less may be no turn at all.
_LEAST = 0.5

# How many times the degrees asked a motion turns at most, and how many times up to 135°: models
# that are asked for 45° turn by 104 to 131°, which is the turn that was asked, too far.
_MOST_TIMES, _SMALL_TIMES, _SMALL = 2.0, 3.0, 135.0

# Degrees by which it may turn back; more is another turn, and which was asked is open.
_BACK = 45.0

# Degrees off that are left as they are.
_EXACT = 1.0

# Seconds by which the heading is smoothed.
_SMOOTH = 0.1

# Degrees of the smallest and the largest turn that is made exact.
_RANGE = (10.0, 1080.0)

# Share of the line between the hips that is along the floor at least; else the body lies.
_LEVEL = 0.7


def exact_turns(
    joints: BatchedJoints, fps: float, skeleton: Skeleton, turns: Sequence[Turn | None]
) -> tuple[BatchedJoints, list[float | None]]:
    """Makes motions turn by what is asked, where it is without doubt the turn that was asked.

    It is where they turn that way by half to twice as much, small angles by three times, and
    never far back.

    Args:
        joints: Positions, meters, y up; joint 0 is the root.
        fps: Frames per second.
        skeleton: Names the hips.
        turns: What is asked of each motion.

    Returns:
        The joints, and the degrees that each motion turned before, left is positive; none where
        it was left as it is.
    """
    before: list[float | None] = [None] * len(turns)
    hips = [skeleton.names.index(n) for n in ("right_hip", "left_hip") if n in skeleton.names]
    if len(hips) < 2 or len(joints) < 3:
        return joints, before
    joints = joints.copy()
    for number, wish in enumerate(turns):
        if wish is not None and _RANGE[0] <= wish.degrees <= _RANGE[1]:
            track = joints[:, number]
            across = track[:, hips[0]] - track[:, hips[1]]
            flat = np.hypot(across[:, 0], across[:, 2])
            if (flat < _LEVEL * np.linalg.norm(across, axis=1)).any():  # the body lies
                continue
            heading = np.unwrap(np.arctan2(across[:, 2], -across[:, 0]))
            heading = gaussian_smooth(heading[:, None], _SMOOTH * fps)[:, 0]
            total = float(np.degrees(heading[-1] - heading[0]))
            wrong = (total > 0) != (wish.side == "left") if wish.side else False
            near = abs(wish.degrees - abs(total)) < _EXACT
            most = max(_MOST_TIMES * wish.degrees, min(_SMALL_TIMES * wish.degrees, _SMALL))
            turned = np.degrees(heading - heading[0]) * np.sign(total)
            back = (np.maximum.accumulate(turned) - turned).max()
            doubtful = back > _BACK or not _LEAST * wish.degrees <= abs(total) <= most
            if wrong or near or doubtful:
                continue
            rates = np.maximum(np.sign(total) * np.diff(heading), 0)
            missing = np.sign(total) * np.radians(wish.degrees - abs(total))
            added = missing * np.concatenate([[0], np.cumsum(rates / rates.sum())])
            # Turns each frame about its root, radians, and the steps of the root with it.
            root = track[:, :1] * np.array([1.0, 0.0, 1.0])
            steps = turn(np.diff(root, axis=0), added[:-1, None])
            path = np.concatenate([root[:1], root[:1] + np.cumsum(steps, axis=0)])
            joints[:, number] = turn(track - root, added[:, None]) + path
            before[number] = total
    return joints, before
