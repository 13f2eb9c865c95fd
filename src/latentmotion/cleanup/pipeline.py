"""The steps of a clean-up in their order, and the settings that choose among them.

Changes: what a clean-up did to a motion, in one line of figures.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain, islice
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import Lengths, length
from latentmotion.cleanup.bones import constant_bones
from latentmotion.cleanup.contacts import Contacts, foot_contacts
from latentmotion.cleanup.exact import as_many_as_fit, exact_turns
from latentmotion.cleanup.floor import Floor, align_floor, hold_seats
from latentmotion.cleanup.foot_lock import FootLock, lock_feet
from latentmotion.cleanup.leg_ik import find_legs, keep_knee_direction
from latentmotion.cleanup.loops import is_loop, rolled_up, turns_beside, unrolled
from latentmotion.cleanup.smoothing import gaussian, settled, sharpened, steadied
from latentmotion.errors import InputError
from latentmotion.kinematics.plausibility import foot_sliding
from latentmotion.kinematics.skeleton import BatchedJoints
from latentmotion.language.claims import NO_CORRECTIONS, Corrections
from latentmotion.motion import Motion, alike
from latentmotion.progress import counted


class CleanUpWarning(UserWarning):
    """A step was skipped or had to move joints far, or fewer repetitions fit than are asked for.

    Args:
        text: What happened.
        motion: The motion that it happened to, before it was cleaned up.
    """

    def __init__(self, text: str, motion: Motion | None = None) -> None:
        super().__init__(text)
        self.motion = motion


# Meters that a joint may move for constant bone lengths without a warning.
_FAR = 0.25

# Seconds that Gaussians reach at most, 0.75; that of `smooth` is 0.56 over its cutoff in hertz.
_REACH = 1.0


@dataclass(frozen=True)
class CleanUp:
    """The steps of a clean-up and their settings.

    Raises:
        InputError: The cutoff is not a positive number.
    """

    # Repeat or leave out an act until it is done as often as the corrections say, which makes the
    # motion shorter or longer.
    exact_count: bool = True
    exact_turn: bool = True  # Turn by the degrees that the corrections say.
    sharpen: bool = True  # Give a generated motion back the quick movement that its decoder loses.
    settle: bool = True  # Let a generated motion come to rest where it idles and at its ends.
    smooth: bool = True  # Remove jitter.
    bones: bool = True  # Give every bone one length.
    floor: bool = True  # Put the figure on the floor.
    seats: bool = True  # Keep who sits on something at its height.
    feet: bool = True  # Lock feet that stand.
    in_place: bool = False  # Remove root motion along the floor, as game engines like it.
    # Hertz up to which movement is kept in a motion that shakes; above, it counts as jitter.
    cutoff: float = 5.0
    contacts: Contacts = field(default_factory=Contacts)  # Thresholds of a standing foot.
    lock: FootLock = field(default_factory=FootLock)  # Settings of foot locks.
    ground: Floor = field(default_factory=Floor)  # Settings of the floor's height.

    def __post_init__(self) -> None:
        if not (np.isfinite(self.cutoff) and self.cutoff > 0):
            raise InputError(f"cutoff {self.cutoff}: expected hertz, a positive number such as 5")


USUAL = CleanUp()  # The steps by default: all that do not move the motion as a whole.


def clean(
    motion: Motion,
    steps: CleanUp | None = None,
    corrections: Corrections = NO_CORRECTIONS,
    in_place: bool = False,
) -> Motion:
    """Returns the motion cleaned up.

    It is as long as before, unless a count is corrected, or rest takes time and it may be longer.

    Args:
        motion: The motion; of a loop (`cleanup/loops.py`) the ends still meet afterwards.
        steps: The clean-up steps; by default all that do not move the motion as a whole.
        corrections: What its sentence says exactly.
        in_place: Whether root motion along the floor is removed, too.

    Warns:
        CleanUpWarning: The skeleton has no feet to lock, so only the other steps are taken; or bone
            lengths were so wrong that joints had to move far.
    """
    steps = steps or USUAL
    steps = replace(steps, in_place=steps.in_place or in_place)
    return clean_batch([motion], steps, [corrections])[0]


def clean_batch(
    motions: Sequence[Motion],
    steps: CleanUp = USUAL,
    corrections: Sequence[Corrections] | None = None,
) -> list[Motion]:
    """Returns the motions cleaned up, each as it would be alone, padded to one length.

    Args:
        motions: The motions.
        steps: The clean-up steps.
        corrections: What the sentence of each says exactly; by default nothing.

    Warns:
        CleanUpWarning: As `clean` does.
    """
    corrections = [NO_CORRECTIONS] * len(motions) if corrections is None else corrections
    if any(map(is_loop, motions)):
        # A turn is cleaned up between others; a count or a turn of a sentence is not a cycle's.
        beside = [turns_beside(motion) if is_loop(motion) else 0 for motion in motions]
        whole = [unrolled(m, n, n) if n else m for m, n in zip(motions, beside, strict=True)]
        exact = [NO_CORRECTIONS if n else c for n, c in zip(beside, corrections, strict=True)]
        every = zip(clean_batch(whole, steps, exact), motions, beside, strict=True)
        return [rolled_up(after, before) if n else after for after, before, n in every]
    pairs, raw = zip(motions, corrections, strict=True), motions
    motions = [_enlivened(motion, correction, steps) for motion, correction in pairs]
    cleaned = _clean_alike(motions, steps, corrections)
    recorded = [motion.recorded for motion in motions]
    counting = [n for n, c in enumerate(corrections) if c.count and steps.exact_count]
    chosen, counts = [motions[n] for n in counting], [corrections[n] for n in counting]
    moving = replace(steps, in_place=False)  # repetitions are counted on the path
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CleanUpWarning)  # whole motions have had their own
        on_path = [cleaned[n] for n in counting]
        on_path = _clean_alike(chosen, moving, counts) if steps.in_place else on_path
        results = _counted_exactly(chosen, on_path, counts, moving)
    for number, (exact, fit) in zip(counting, results, strict=True):
        motion, count = motions[number], corrections[number].count
        if fit and count:
            text = f"{_named(motion)}{count.times} times take too long, {fit} fit"
            warnings.warn(CleanUpWarning(text, raw[number]), stacklevel=3)
        joints = in_place(exact.joints, exact.fps) if steps.in_place else exact.joints
        cleaned[number] = replace(exact, joints=joints)
        if len(exact) != len(motion):
            recorded[number] = None  # its frames are others
    return [
        after.with_recorded(source.following(before.joints, after.joints)) if source else after
        for before, after, source in zip(motions, cleaned, recorded, strict=True)
    ]


def _counted_exactly(
    motions: Sequence[Motion],
    cleaned: Sequence[Motion],
    corrections: Sequence[Corrections],
    steps: CleanUp,
) -> list[tuple[Motion, int]]:
    """Returns what `as_many_as_fit` does of each; candidates of all are cleaned up together."""
    every = zip(motions, cleaned, corrections, strict=True)
    searches = [as_many_as_fit(motion, whole, c.count) for motion, whole, c in every if c.count]
    results: dict[int, tuple[Motion, int]] = {}
    replies: dict[int, Any] = dict.fromkeys(range(len(searches)))
    while replies:
        candidates: dict[int, Sequence[Motion]] = {}
        for number, reply in replies.items():
            try:
                candidates[number] = searches[number].send(reply)
            except StopIteration as end:
                results[number] = end.value
        theirs = [corrections[number] for number, some in candidates.items() for _ in some]
        again = iter(_clean_alike([*chain(*candidates.values())], steps, theirs))
        replies = {number: [*islice(again, len(some))] for number, some in candidates.items()}
    return [results[number] for number in range(len(searches))]


def _enlivened(motion: Motion, correction: Corrections, steps: CleanUp) -> Motion:
    """Returns a generated motion with quick movement as quick and rest as calm as in recordings."""
    sharpens, settles = correction.sharpens and steps.sharpen, correction.settles and steps.settle
    if not (sharpens or settles):
        return motion
    joints = motion.joints.astype(np.float64)
    if sharpens:
        joints = sharpened(joints, motion.fps)
    if settles:
        joints = settled(joints, motion.fps, motion.skeleton, correction.longest)
    return replace(motion, joints=joints.astype(np.float32))


def _clean_alike(
    motions: Sequence[Motion], steps: CleanUp, corrections: Sequence[Corrections]
) -> list[Motion]:
    """Cleans motions up, padded to one length."""
    cleaned = list(motions)
    for numbers in counted(_groups(motions, steps.cutoff), "cleaning up"):
        batch = [motions[n] for n in numbers]
        counts, fps, skeleton = [*map(len, batch)], batch[0].fps, batch[0].skeleton
        lengths = np.array(counts) if counts[0] < counts[-1] else None
        joints = np.zeros((counts[-1], len(batch), len(skeleton), 3))
        turned: list[float | None] = [None] * len(batch)
        for column, (motion, count) in enumerate(zip(batch, counts, strict=True)):
            joints[:count, column], joints[count:, column] = motion.joints, motion.joints[-1]
            turn = corrections[numbers[column]].turn if steps.exact_turn else None
            if turn is not None:
                track = joints[:count, column : column + 1]
                track[:], (turned[column],) = exact_turns(track, fps, skeleton, [turn])
        if steps.smooth:
            steady = steadied(joints, fps, steps.cutoff, lengths)
            joints = keep_knee_direction(steady, joints, skeleton)
        if steps.bones:
            before, joints = joints, constant_bones(joints, fps, skeleton, lengths)
            _warn_of_far(before, joints, batch)
        on_floor = np.array([corrections[n].on_floor for n in numbers])
        joints = _grounded(joints, batch, steps, on_floor, lengths).astype(np.float32)
        for column, (number, degrees) in enumerate(zip(numbers, turned, strict=True)):
            about, turn = dict(motions[number].metadata), corrections[number].turn
            if turn is not None and degrees is not None:
                about["turn"] = {**asdict(turn), "made": round(degrees, 1)}
            after = joints[: counts[column], column]
            cleaned[number] = replace(motions[number], joints=after, metadata=about)
    return cleaned


def _groups(motions: Sequence[Motion], cutoff: float) -> list[list[int]]:
    """Returns which motions are padded to one length, the shortest of each first.

    Those shorter than what a Gaussian reaches are with their like, since it reaches less there.
    """

    def own_length(motion: Motion) -> int:
        return len(motion) if len(motion) <= motion.fps * max(_REACH, _REACH / cutoff) else 0

    return alike(motions, own_length)


def _warn_of_far(before: BatchedJoints, joints: BatchedJoints, motions: Sequence[Motion]) -> None:
    """Warns of joints that had to move far for constant bones."""
    moved = length(joints - before)
    for motion in np.flatnonzero(moved.max(axis=(0, 2)) > _FAR).tolist():
        distance = moved[:, motion]
        frame, joint = np.unravel_index(distance.argmax(), distance.shape)
        fps, skeleton = motions[motion].fps, motions[motion].skeleton
        warnings.warn(
            CleanUpWarning(
                f"{_named(motions[motion])}bones were drawn so long or short that "
                f"{skeleton.names[joint]} was moved by "
                f"{100 * distance.max():.0f} cm at {frame / fps:.1f} s to give them one length",
                motions[motion],
            ),
            stacklevel=4,
        )


def _grounded(
    joints: BatchedJoints,
    motions: Sequence[Motion],
    steps: CleanUp,
    on_floor: Bool[np.ndarray, " motions"],
    lengths: Lengths,
) -> BatchedJoints:
    """Puts figures on the floor, and holds their seats and feet."""
    fps, skeleton = motions[0].fps, motions[0].skeleton
    if steps.floor:
        joints = align_floor(joints, fps, skeleton, steps.ground, on_floor, lengths)
    if steps.seats:
        joints = hold_seats(joints, fps, skeleton, lengths)
    if steps.feet:
        if find_legs(skeleton):
            contacts = foot_contacts(joints, fps, skeleton, steps.contacts, lengths)
            joints = lock_feet(joints, contacts, fps, skeleton, steps.lock, lengths)
        else:
            warnings.warn(
                f"{_named(motions[0])}skeleton {skeleton.name!r} names no feet below hip and knee; "
                "feet were left as they are",
                CleanUpWarning,
                stacklevel=4,
            )
    if steps.in_place:
        joints = joints - ground_path(joints, fps, lengths=lengths)[..., None, :]
    return joints


def ground_path(
    joints: BatchedJoints, fps: float, seconds: float = 0.25, lengths: Lengths = None
) -> Float[np.ndarray, "frames *batch 3"]:
    """Returns the root trajectory along the floor, without the sway of its steps.

    Args:
        joints: Positions, meters, y up; joint 0 is the root.
        fps: Frames per second.
        seconds: Standard deviation of the Gaussian that removes the sway; 0 keeps it.
        lengths: Frames of each motion of a padded batch.
    """
    return gaussian(joints[..., 0, :] * (1, 0, 1), seconds * fps, lengths)


def in_place(joints: BatchedJoints, fps: float) -> BatchedJoints:
    """Returns the joints without root motion: the figure stays above the origin."""
    return joints - ground_path(joints, fps)[..., None, :]


def _named(motion: Motion) -> str:
    """Returns which take a warning is about: caption and seed, as far as they are known."""
    seed = motion.metadata.get("seed")
    parts = [repr(motion.caption)] if motion.caption else []
    parts += [] if seed is None else [f"seed {seed}"]
    return f"{', '.join(parts)}: " if parts else ""


# Meters that joints may move on average, and share of the path's length that may change, without
# a warning.
_MOVED, _OFF = 0.1, 0.05


@dataclass(frozen=True)
class Changes:
    """How a motion differs from what it was."""

    lifted: float  # Meters by which the whole figure was lifted onto the floor, or lowered.
    mean: float  # Meters that a joint moved besides, on average.
    most: float  # Meters that a joint moved at most.
    path: float  # Length of the path along the floor, as a share of what it was, less 1.
    lowest: tuple[float, float]  # Height of the lowest joint before and after, meters.
    sliding: tuple[float, float]  # Mean speed of standing feet before and after, m/s.

    @classmethod
    def of(cls, before: Motion, after: Motion) -> Changes:
        """Compares two motions of one skeleton, frame by frame as far as both go."""
        count = min(len(before), len(after))
        moved = after.joints[:count] - before.joints[:count]
        lifted = float(np.median(moved[..., 1]))
        moved = length(moved - np.array([0, lifted, 0]))
        # Along the floor, in steps of a quarter of a second.
        step = max(1, round(before.fps / 4))
        paths = (motion.joints[:count:step, 0, ::2] for motion in (before, after))
        old, new = (float(length(np.diff(path, axis=0)).sum()) for path in paths)
        return cls(
            lifted,
            float(moved.mean()),
            float(moved.max()),
            new / old - 1 if old > _SHORT else 0.0,
            (float(before.joints[..., 1].min()), float(after.joints[..., 1].min())),
            (_sliding(before), _sliding(after)),
        )

    @property
    def text(self) -> str:
        """All figures, in one line."""
        (low, lower), (slid, slides) = self.lowest, self.sliding
        lift = f"lifted {100 * self.lifted:+.1f} cm; " if abs(self.lifted) > _LIFTED else ""
        return (
            f"{lift}joints moved {100 * self.mean:.1f} cm on average, at most "
            f"{100 * self.most:.1f} cm; lowest point {100 * low:.1f} → {100 * lower:.1f} cm; "
            f"feet slide {100 * slid:.1f} → {100 * slides:.1f} cm/s; path {self.path:+.1%}"
        )

    @property
    def problem(self) -> str | None:
        """What is more than a clean-up should change, if anything is."""
        if self.mean > _MOVED:
            return (
                f"joints moved {100 * self.mean:.0f} cm on average, more than {100 * _MOVED:.0f}: "
                "look at the result, and check unit, axes and floor of the file"
            )
        if abs(self.path) > _OFF:
            return f"the path changed by {self.path:+.0%}, more than {_OFF:.0%}: look at the result"
        return None


# Meters of the whole figure that are told.
_LIFTED = 0.005

# Meters of a path whose change of length says nothing.
_SHORT = 0.5


def _sliding(motion: Motion) -> float:
    return foot_sliding(motion.joints, motion.fps, motion.skeleton, floor_under(motion.joints))


def floor_under(joints: Float[np.ndarray, "frames joints 3"]) -> float:
    """Returns the height of what feet stand on, roughly: where the lowest joint is often."""
    return float(np.percentile(joints[..., 1].min(axis=1), 5))
