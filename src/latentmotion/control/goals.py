"""Goals: where joints should be at given times, which way the body should face, its path, a pose.

Seconds, meters, y up, joints by name. A motion starts above the origin and faces +z; +x is on its
left. A goal that no person could meet is refused before anything is generated.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.errors import InputError, hint
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading

FASTEST = 8.0
"""Meters per second that a person can run."""

_STANDING = 1.1
"""Height of the pelvis, meters, that a standing body does not exceed."""

_JUMP = 0.7
"""Meters that a person can jump."""

_TURN = 0.3
"""Meters that a radian of heading counts as, about half the width of the shoulders."""

Coordinate = float | None


@dataclass(frozen=True)
class Reach:
    """A joint is at a place at a time."""

    joint: str
    """Name of the joint, e.g. `right_wrist`."""
    at: float
    """Seconds from the start."""
    to: tuple[Coordinate, Coordinate, Coordinate]
    """Meters, x, y and z; None leaves a coordinate free."""


@dataclass(frozen=True)
class Heading:
    """The body faces a direction at a time."""

    at: float
    """Seconds from the start."""
    degrees: float
    """0 is +z, where the motion starts to face; 90 is +x, to its left."""


@dataclass(frozen=True)
class RootPath:
    """The pelvis goes along a curve through points of the floor."""

    points: Sequence[tuple[float, float]]
    """Meters, x and z, in order. The motion starts at the first and faces along the curve."""
    at: Sequence[float] | None = None
    """Seconds at which it passes each point; by default the whole curve takes the whole motion, at
    the speeds that the prompt asks for."""


@dataclass(frozen=True, eq=False)
class Pose:
    """All joints are at the places that they have in a frame of another motion."""

    at: float
    """Seconds from the start."""
    motion: Motion
    """Has the frame; where its skeleton lacks a joint, that joint is free."""
    frame: int = 0
    """Number of the frame; a negative one counts from the end."""

    def reaches(self, skeleton: Skeleton) -> list[Reach]:
        """Returns the place of each joint.

        Raises:
            InputError: There is no such frame, or the skeletons have hardly a joint in common.
        """
        count, names = len(self.motion), self.motion.skeleton.names
        if not -count <= self.frame < count:
            raise InputError(f"frame {self.frame} of a pose: its motion has {count}")
        shared = [name for name in skeleton.names if name in names]
        if len(shared) < 3:
            raise InputError(
                f"a pose of skeleton {self.motion.skeleton.name!r} shares {len(shared)} joints "
                f"with {skeleton.name!r}; convert it first: latentmotion.to_humanml3d"
            )
        joints = self.motion.joints[self.frame].astype(float)
        places = {name: joints[names.index(name)].tolist() for name in shared}
        return [Reach(name, self.at, (x, y, z)) for name, (x, y, z) in places.items()]


Goal = Reach | Heading | RootPath | Pose


@dataclass(frozen=True, eq=False)
class Targets:
    """Goals as arrays: coordinates of joints in frames, and headings."""

    frames: Int[np.ndarray, " points"]
    """Frame of each point."""
    joints: Int[np.ndarray, " points"]
    """Its joint."""
    places: Float[np.ndarray, "points 3"]
    """Where it should be, meters; NaN leaves a coordinate free."""
    turned: Int[np.ndarray, " headings"]
    """Frames in which the heading is given."""
    headings: Float[np.ndarray, " headings"]
    """Radians from +z toward +x."""

    @property
    def fixed(self) -> Bool[np.ndarray, "points 3"]:
        """True on coordinates that are given."""
        return np.isfinite(self.places)

    def joined(self, other: Targets) -> Targets:
        """Returns these targets and others."""
        return Targets(
            *(
                np.concatenate([own, more])
                for own, more in zip(vars(self).values(), vars(other).values(), strict=True)
            )
        )


NO_TARGETS = Targets(
    np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), np.zeros(0, int), np.zeros(0)
)


@dataclass(frozen=True, eq=False)
class TargetResidual:
    """Residuals to targets, and their derivatives by the joints."""

    targets: Targets
    skeleton: Skeleton

    def __call__(self, joints: Float[np.ndarray, "frames joints 3"]) -> Float[np.ndarray, " rows"]:
        """Returns goal minus joint, meters; a radian of heading counts as 0.3 m."""
        targets = self.targets
        gaps = targets.places - joints[targets.frames, targets.joints]
        turns = targets.headings - heading(joints[targets.turned], self.skeleton)
        turns = (turns + np.pi) % (2 * np.pi) - np.pi
        return np.concatenate([gaps[targets.fixed], _TURN * turns])

    def gradient(
        self, joints: Float[np.ndarray, "frames joints 3"]
    ) -> Float[np.ndarray, "rows frames joints 3"]:
        """Returns the derivatives of these coordinates and headings."""
        targets = self.targets
        point, axis = np.nonzero(targets.fixed)
        found = np.zeros((len(point) + len(targets.turned), *joints.shape))
        found[np.arange(len(point)), targets.frames[point], targets.joints[point], axis] = 1
        names = self.skeleton.names
        sides = [
            (names.index(f"{side}_{part}"), sign)
            for part in ("hip", "shoulder")
            for side, sign in (("right", 1), ("left", -1))
        ]
        for row, frame in enumerate(targets.turned, start=len(point)):
            across = sum(sign * joints[frame, joint] for joint, sign in sides)
            x, z = across[0], across[2]  # type: ignore[index]
            slope = _TURN * np.array([z, 0.0, -x]) / max(x * x + z * z, 1e-9)
            for joint, sign in sides:
                found[row, frame, joint] = sign * slope
        return found


def targets_of(
    goals: Iterable[Goal],
    frames: int,
    fps: float,
    skeleton: Skeleton,
    start: tuple[float, float] | None = (0.0, 0.0),
) -> Targets:
    """Returns goals other than paths as arrays, after a check of each.

    Args:
        goals: What is wanted; paths are left out.
        frames: Length of the motion.
        fps: Frames per second.
        skeleton: Names the joints.
        start: Where on the floor the motion starts, x and z; None where goals are checked already.

    Raises:
        InputError: No person could meet a goal, or it is beyond the motion.
    """
    points: list[tuple[int, int, tuple[float, ...]]] = []
    turns: dict[int, float] = {}
    for goal in goals:
        if isinstance(goal, RootPath):
            continue
        frame = frame_at(goal.at, frames, fps)
        if isinstance(goal, Heading):
            if not np.isfinite(goal.degrees):
                raise InputError(f"heading {goal.degrees}: expected degrees")
            if frame in turns:
                raise InputError(f"two headings at {goal.at:g} s: leave one out")
            turns[frame] = float(np.radians(goal.degrees))
            continue
        for place in [goal] if isinstance(goal, Reach) else goal.reaches(skeleton):
            to = tuple(np.nan if value is None else float(value) for value in place.to)
            points.append((frame, _joint(place.joint, skeleton), to))
    targets = Targets(
        np.array([point[0] for point in points], int),
        np.array([point[1] for point in points], int),
        np.array([point[2] for point in points], float).reshape(-1, 3),
        np.array(list(turns), int),
        np.array(list(turns.values()), float),
    )
    if start is not None:
        check_targets(targets, fps, skeleton, start)
    return targets


def frame_at(at: float, frames: int, fps: float) -> int:
    """Returns the frame nearest to a time.

    Raises:
        InputError: The time is not within the motion.
    """
    last = (frames - 1) / fps
    if not (np.isfinite(at) and -0.5 / fps <= at <= last + 1 / fps + 1e-6):
        raise InputError(
            f"a goal at {at:g} s: the motion lasts from 0 to {last:g} s; "
            "ask for more seconds or an earlier goal"
        )
    return min(max(round(at * fps), 0), frames - 1)


def check_targets(
    targets: Targets, fps: float, skeleton: Skeleton, start: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Compares goals with what people can do.

    Raises:
        InputError: Two goals are for one joint at one time, or one is beyond the reach of a body
            that starts at the origin and runs as fast as people can.
    """
    length, names = _distances(skeleton), skeleton.names
    found: dict[tuple[int, int], np.ndarray] = {}
    for frame, joint, place in zip(targets.frames, targets.joints, targets.places, strict=True):
        key, name, at = (int(frame), int(joint)), names[joint], frame / fps
        if key in found:
            raise InputError(f"two goals for {name} at {at:g} s: leave one out")
        if np.isinf(place).any() or np.isnan(place).all():
            raise InputError(f"goal of {name} at {at:g} s: expected meters for x, y or z")
        found[key] = place
        highest = _STANDING + _JUMP + length[0, joint]
        if place[1] > highest or place[1] < -0.1:
            raise InputError(
                f"goal of {name} at {at:g} s is {place[1]:g} m high: this body reaches from the "
                f"floor, 0 m, to {highest:.1f} m in a jump"
            )
        far = float(np.linalg.norm(np.nan_to_num(place[::2] - start)))
        within = FASTEST * at + length[0, joint] + 0.1
        if far > within:
            raise InputError(
                f"goal of {name} at {at:g} s is {far:.1f} m from the start: within that time a "
                f"person who runs {FASTEST:g} m/s reaches {within:.1f} m; set it nearer or later"
            )
    ordered = sorted(found.items())
    for ((frame, joint), place), ((later, other), goal) in pairwise(ordered):
        room = length[joint, other] * 1.05 + 0.05 + FASTEST * (later - frame) / fps
        far = float(np.linalg.norm(np.nan_to_num(goal - place)))
        if far > room:
            raise InputError(
                f"goals of {names[joint]} at {frame / fps:g} s and of {names[other]} at "
                f"{later / fps:g} s are {far:.1f} m apart: this body and {FASTEST:g} m/s allow "
                f"{room:.1f} m"
            )


def check_path(path: RootPath, frames: int, fps: float) -> None:
    """Compares a path with what people can do.

    Raises:
        InputError: It has fewer than two points, times that do not ascend, or is too fast.
    """
    points = np.array(path.points, float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
        raise InputError("a path needs two points or more, each x and z in meters")
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if (lengths < 1e-3).any():
        first = int(lengths.argmin()) + 1
        raise InputError(
            f"points {first} and {first + 1} of the path are at one place; move or remove one"
        )
    if path.at is None:
        times = np.linspace(0, (frames - 1) / fps, 2)
        lengths = lengths.sum(keepdims=True)
    else:
        times = np.array(path.at, float)
        if len(times) != len(points):
            raise InputError(f"{len(times)} times for {len(points)} points of a path")
        for time in times:
            frame_at(time, frames, fps)
        if abs(times[0]) > 0.5 / fps:
            raise InputError(
                f"the path starts at {times[0]:g} s: expected 0, where the motion does"
            )
    if not (np.diff(times) > 0).all():
        raise InputError("the times of a path have to ascend")
    speeds = lengths / np.diff(times)
    if speeds.max() > FASTEST:
        part = int(speeds.argmax())
        raise InputError(
            f"the path asks for {speeds[part]:.1f} m/s from {times[part]:g} to {times[part + 1]:g} "
            f"s: people run {FASTEST:g} m/s at most; give it more time"
        )


def _joint(name: str, skeleton: Skeleton) -> int:
    if name not in skeleton.names:
        raise InputError(f"unknown joint {name!r}: {hint(name, skeleton.names)}")
    return skeleton.names.index(name)


def _distances(skeleton: Skeleton) -> Float[np.ndarray, "joints joints"]:
    """Returns the length of the bones between any two joints, meters."""
    bones = np.linalg.norm(skeleton.offsets, axis=-1)
    above: list[set[int]] = []
    for joint, parent in enumerate(skeleton.parents):
        above.append({joint} | (above[parent] if parent >= 0 else set()))
    return np.array([[sum(bones[j] for j in own ^ other) for other in above] for own in above])
