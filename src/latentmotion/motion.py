"""Motion: joint positions over time. It is data, and knows no room that works on it.

`save`, `load`, `cleaned` and the view in a notebook are looked up by name among what other rooms
have registered (`plugins.register`), which the package does when it is imported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Joints, Skeleton, interpolate
from latentmotion.language.claims import NO_CORRECTIONS, Corrections, mirror_words
from latentmotion.plugins import registered
from latentmotion.progress import counted
from latentmotion.storage.limits import FARTHEST, LEAST_FPS, MOST_FPS

if TYPE_CHECKING:
    from latentmotion.kinematics.recorded import Recorded
    from latentmotion.kinematics.standing import Stated
    from latentmotion.measure.objects import ImpliedObject
    from latentmotion.representation.interface import Representation


# Metadata that hold for a motion's frames as they were generated.
_OF_FRAMES = ("goals", "spans", "foot_sliding", "turn", "count", "loop")


@dataclass(frozen=True, eq=False)
class Motion:
    """One person moving: joint positions, meters, y up.

    Args:
        joints: Global joint positions, frames × joints × 3, meters.
        fps: Frames per second.
        skeleton: Names and parents of the joints.
        caption: The sentence it was made from, or that describes it.
        metadata: Any values that JSON can hold: model, seed, guidance, rights, weights_license.

    Raises:
        InputError: The joints are empty, not finite, or not those of the skeleton.
    """

    joints: Joints
    """Global joint positions, float32, meters."""
    fps: float = 20.0
    """Frames per second."""
    skeleton: Skeleton = HUMANML3D
    """Names and parents of the joints."""
    caption: str = ""
    """The sentence it was made from, or that describes it."""
    metadata: Mapping[str, Any] = field(default_factory=dict)
    """Any values that JSON can hold: model, seed, guidance, rights, weights_license."""
    recorded: Recorded | None = field(default=None, init=False, repr=False)
    """The animation it was read from, with all its joints; None once its joints are others."""

    def __post_init__(self) -> None:
        with np.errstate(over="ignore"):  # told below
            joints = np.asarray(self.joints, dtype=np.float32)
        expected = (len(self.skeleton), 3)
        if joints.ndim != 3 or joints.shape[1:] != expected or not len(joints):
            raise InputError(
                f"a motion of skeleton {self.skeleton.name!r} needs joints of shape "
                f"(frames ≥ 1, {expected[0]}, 3), found {joints.shape}"
            )
        if not np.abs(joints).max() <= FARTHEST:  # nor is NaN
            finite = np.isfinite(joints).all(axis=(1, 2))
            if not finite.all():
                raise InputError(
                    f"{int((~finite).sum())} of {len(joints)} frames hold NaN or infinite "
                    f"positions, first in frame {int(np.argmin(finite))}; cut or repair them"
                )
            raise InputError(f"joints are beyond {FARTHEST:,.0f} m; check the unit of length")
        if not LEAST_FPS <= self.fps <= MOST_FPS:
            expected = f"expected a positive number, {LEAST_FPS:g} to {MOST_FPS:,.0f}"
            raise InputError(f"fps is {self.fps}, {expected}")
        object.__setattr__(self, "joints", joints)

    def __len__(self) -> int:
        return len(self.joints)

    def __repr__(self) -> str:
        caption = f"{self.caption!r}, " if self.caption else ""
        rate = f"{len(self)} frames at {self.fps:g} per second"
        return f"Motion({caption}{self.seconds:.2f} s, {rate}, {self.skeleton.name})"

    @property
    def seconds(self) -> float:
        """Duration in seconds."""
        return len(self) / self.fps

    def with_recorded(self, recorded: Recorded | None) -> Motion:
        """Returns the motion with the animation whose joints it has."""
        motion = replace(self)
        object.__setattr__(motion, "recorded", recorded)
        return motion

    @cached_property
    def objects(self) -> tuple[ImpliedObject, ...]:
        """Seats, steps and boxes that carry the body, from its joints and its caption.

        Files that have nodes get one for each, named as `seat at 0.45 m`.
        """
        return registered("motion.objects")(self)

    def animation(self) -> Animation:
        """Returns the local rotations whose forward kinematics are these joints."""
        return self._solved

    def resampled(self, fps: float) -> Motion:
        """Returns the motion at another frame rate: its rotations resampled, see `Animation`.

        Bones that change their lengths get their median; clean the motion first to choose how. A
        loop gets a whole number of frames, by up to half a frame longer or shorter.

        Raises:
            InputError: `fps` is not a positive number, or far too large.
        """
        if fps == self.fps:
            return self
        steps = (len(self) - 1) * fps / self.fps
        exact = (
            fps * round(steps) / steps if self.metadata.get("loop") and 1 <= steps < 1e9 else fps
        )
        animation = replace(self.animation().resampled(exact), fps=float(fps))
        motion = replace(self, joints=animation.joints().astype(np.float32), fps=animation.fps)
        # Its rotations are known, so writers need not solve for them again.
        motion.__dict__["_solved"] = animation
        return motion.with_recorded(self.recorded and self.recorded.resampled(fps))

    def cut(self, start: float = 0.0, end: float | None = None) -> Motion:
        """Returns the part between two times, where and as it was.

        Args:
            start: Seconds from the beginning.
            end: Seconds from the beginning; by default the motion's end.

        Raises:
            InputError: There is no frame between them.
        """
        last = self.seconds if end is None else end
        first, stop = round(start * self.fps), round(last * self.fps)
        if not 0 <= first < stop <= len(self):
            raise InputError(
                f"cut from {start:g} to {last:g} s: expected times in order, from 0 to "
                f"{self.seconds:g} s, at least a frame apart"
            )
        part = self.with_joints(self.joints[first:stop], self.caption)
        return part.with_recorded(self.recorded and self.recorded.cut(first, stop))

    def joined(self, *others: Motion) -> Motion:
        """Returns motions one after the other, each from where the one before ends, facing its way.

        They are joined by a cut; `control.edit.generate_between` generates a transition.

        Raises:
            InputError: They differ in skeleton or frame rate.
        """
        from latentmotion.representation.canonical import heading, turn

        for other in others:
            if (other.skeleton.names, other.fps) != (self.skeleton.names, self.fps):
                raise InputError(
                    f"{other!r} cannot follow {self!r}: expected the same skeleton and frame "
                    "rate; call resampled first"
                )
        joints, on_floor = self.joints, np.array([1, 0, 1], np.float32)
        for other in others:
            last, first = joints[-1], other.joints[0]
            angle = heading(last, self.skeleton) - heading(first, self.skeleton)
            turned = turn(other.joints - first[0] * on_floor, np.asarray(angle))
            joints = np.concatenate([joints, turned + last[0] * on_floor])
        captions = [each.caption for each in (self, *others) if each.caption]
        return self.with_joints(joints, ", then ".join(captions))

    def mirrored(self) -> Motion:
        """Returns the mirror image: left and right are swapped, in the caption too."""
        joints = self.joints[:, self.skeleton.mirror] * np.array([-1, 1, 1], np.float32)
        return self.with_joints(joints, mirror_words(self.caption))

    def at_speed(self, speed: float) -> Motion:
        """Returns the motion so many times as fast, at its own frame rate.

        Raises:
            InputError: `speed` is not a number from 0.1 to 10.
        """
        if not 0.1 <= speed <= 10:
            raise InputError(f"speed {speed:g}: expected 0.1 to 10 times as fast as it is")
        recorded = self.recorded and self.recorded.at_rate(self.fps * speed)
        faster = replace(self, fps=self.fps * speed).with_recorded(recorded).resampled(self.fps)
        return faster.with_joints(faster.joints, self.caption).with_recorded(faster.recorded)

    def with_joints(self, joints: Joints, caption: str) -> Motion:
        """Returns other joints of this motion, without what was said of its own frames."""
        metadata = {name: it for name, it in self.metadata.items() if name not in _OF_FRAMES}
        return replace(self, joints=joints, caption=caption, metadata=metadata)

    def cleaned(
        self, steps: Any = None, corrections: Corrections = NO_CORRECTIONS, in_place: bool = False
    ) -> Motion:
        """Returns the motion with still feet, constant bones and less jitter.

        Args:
            steps: A `latentmotion.cleanup.CleanUp`; by default all steps that do not move the
                motion as a whole.
            corrections: Degrees and repetitions that are made exact.
            in_place: Whether the path along the floor is taken away, too.
        """
        return registered("motion.cleaned")(self, steps, corrections, in_place)

    def save(self, path: str | Path, fps: float | None = None) -> list[Path]:
        """Writes a file in the format of the ending of `path`; returns the files written.

        Args:
            path: File to write.
            fps: Frames per second of the file; by default the motion's own.

        Raises:
            InputError: The ending is unknown or the folder cannot be written.
            MissingExtraError: The format needs a package that is not installed.
        """
        return registered("motion.save")(path, [self], fps)

    @classmethod
    def load(cls, path: str | Path, stated: Stated | None = None) -> Motion:
        """Reads the first motion of a file that `save` can write and that holds joints.

        Args:
            path: The file.
            stated: Unit, up axis, frame rate and joint maps, where the file or what the body shows
                is wrong.

        Raises:
            DataError: The names of its joints are unknown, or its size or pose is nobody's.
            FileFormatError: The file is damaged or not of its kind.
            InputError: The ending is not readable, or there is no such file.

        Warns:
            ReadingWarning: Unit or axes are a guess.
        """
        return registered("motion.load")(path, stated)[0]

    @cached_property
    def _solved(self) -> Animation:
        from latentmotion.kinematics.inverse_kinematics import solve

        return self._turning(solve(self.joints, self.fps, self.skeleton))

    def _turning(self, solved: Animation) -> Animation:
        """Returns rotations that turn what positions do not show as it was recorded."""
        if self.recorded is None or self.skeleton.names != HUMANML3D.names:
            return solved
        return self.recorded.turning(solved)

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        """Shows a strip in a notebook, and the moving figure where scripts run."""
        return registered("motion.notebook")(self)


_TOGETHER = 32  # Motions that are worked on together at most, which bounds memory.


def alike(motions: Sequence[Motion], length: Callable[[Motion], int] = len) -> list[list[int]]:
    """Returns which motions can be worked on together: those of one length, rate and skeleton.

    Args:
        motions: The motions; the shortest come first.
        length: What counts as their lengths.
    """
    groups: dict[tuple[int, float, Skeleton], list[int]] = {}
    for number in sorted(range(len(motions)), key=lambda n: len(motions[n])):
        motion = motions[number]
        groups.setdefault((length(motion), motion.fps, motion.skeleton), []).append(number)
    return [
        every[first : first + _TOGETHER]
        for every in groups.values()
        for first in range(0, len(every), _TOGETHER)
    ]


def animations(motions: Sequence[Motion]) -> list[Animation]:
    """Returns what `Motion.animation` does; those of one length are solved together, faster."""
    from latentmotion.kinematics.inverse_kinematics import solve_batch

    new = [motion for motion in motions if "_solved" not in motion.__dict__]
    for numbers in counted(alike(new), "finding rotations"):
        first = new[numbers[0]]
        joints = np.stack([new[number].joints for number in numbers], axis=1)
        solutions = solve_batch(joints, first.fps, first.skeleton)
        for number, animation in zip(numbers, solutions, strict=True):
            new[number].__dict__["_solved"] = new[number]._turning(animation)
    return [motion.animation() for motion in motions]


# Frames at 20 a second of the shortest motion whose features say anything.
_SHORTEST = 5


def features_of(
    motion: Motion, representation: Representation
) -> Float[np.ndarray, "frames features"]:
    """Returns a motion's features at the representation's frame rate, for a body of its size.

    Raises:
        InputError: The motion has another skeleton, or is shorter than 0.3 s.
    """
    if motion.skeleton.names != representation.skeleton.names:
        raise InputError(
            f"the motion's skeleton is {motion.skeleton.name!r}, expected "
            f"{representation.skeleton.name!r}; convert it first: latentmotion.to_humanml3d"
        )
    joints = motion.joints.astype(np.float64)
    if len(motion) > 1 and motion.fps != representation.fps:
        joints = interpolate(joints, motion.fps / representation.fps)
    if len(joints) < _SHORTEST:
        raise InputError(f"a motion of {motion.seconds:.2f} s; expected 0.3 s or more")
    return representation.encode(representation.retarget(joints))
