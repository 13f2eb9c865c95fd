"""Goals: where joints should be and when, which way body and head face, a path, a pose.

Seconds, meters, y up, joints by name. A motion starts above the origin and faces +z; +x is on its
left. A goal that no person could meet is refused before anything is generated.

Goals may hold for some time. A hand is a point on the line of its forearm beyond the wrist.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.arrays import unit
from latentmotion.cleanup.floor import find_arms
from latentmotion.errors import InputError, named
from latentmotion.kinematics.bone_names import BEYOND_WRIST
from latentmotion.kinematics.skeleton import Joints, Skeleton
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn

FASTEST = 8.0  # Meters per second that a person can run.

# Height of the pelvis, meters, that a standing body does not exceed.
_STANDING = 1.1

# Meters that a person can jump.
_JUMP = 0.7

# Meters that a radian of heading counts as, about half the width of the shoulders.
_TURN = 0.3

Coordinate = float | None


@dataclass(frozen=True)
class Reach:
    """A joint, or a part of a hand, is at a place at a time, or from then on until another."""

    joint: str
    """Name of the joint, e.g. `right_wrist`, or `right_hand` (the palm) or `right_fingertips`."""
    at: float
    """Seconds from the start."""
    to: tuple[Coordinate, Coordinate, Coordinate]
    """Meters, x, y and z; None leaves a coordinate free."""
    until: float | None = None
    """Seconds until which it stays there; by default it is there for an instant."""
    relative_to: str | None = None
    """Joint from which `to` counts, in the body's directions: x to its left, y up, z ahead."""


@dataclass(frozen=True)
class Heading:
    """The body faces a direction at a time, or from then on until another."""

    at: float
    """Seconds from the start."""
    degrees: float
    """0 is +z, where the motion starts to face; 90 is +x, to its left."""
    until: float | None = None
    """Seconds until which it faces there."""


@dataclass(frozen=True)
class LookAt:
    """The head is turned so that the eyes look at a point; places of joints do not change."""

    at: float
    """Seconds from the start."""
    to: tuple[float, float, float]
    """Meters, x, y and z."""
    until: float | None = None
    """Seconds until which they look there."""


@dataclass(frozen=True)
class RootPath:
    """The pelvis goes along a curve through points of the floor."""

    points: Sequence[tuple[float, float]]
    """Meters, x and z, in order. The motion starts at the first and faces along the curve."""
    at: Sequence[float] | None = None
    """Seconds at which it passes each point; by default the whole curve takes the whole motion, at
    the speeds that the prompt asks for."""
    pace: float | Sequence[float] | None = None
    """In place of `at`: meters per second along the curve, one number or one for each point,
    between which it changes evenly."""


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


Goal = Reach | Heading | LookAt | RootPath | Pose
# A goal that clean-up may move, so that it is met once more after it.
Directed = Reach | Heading | LookAt | Pose


@dataclass(frozen=True)
class HandPoint:
    """A point of a hand."""

    name: str  # Such as `right_hand`.
    elbow: int  # Joint where the forearm begins.
    wrist: int  # Joint where it ends.
    beyond: float  # Meters from the wrist to the point.


@lru_cache(maxsize=16)
def hand_points(skeleton: Skeleton) -> tuple[HandPoint, ...]:
    """Returns the points of hands that can have goals; as joints they follow the skeleton's."""
    return tuple(
        HandPoint(skeleton.names[wrist].replace("wrist", part), elbow, wrist, meters)
        for _, elbow, wrist in find_arms(skeleton)
        for part, meters in BEYOND_WRIST.items()
    )


def with_hands(
    joints: Float[np.ndarray, "*batch joints 3"], skeleton: Skeleton
) -> Float[np.ndarray, "*batch points 3"]:
    """Returns the joints, and after them the points of hands."""
    hands = hand_points(skeleton)
    if not hands:
        return joints
    wrists, elbows = ([getattr(hand, name) for hand in hands] for name in ("wrist", "elbow"))
    beyond = np.array([[hand.beyond] for hand in hands])
    along = unit(joints[..., wrists, :] - joints[..., elbows, :])
    return np.concatenate([joints, joints[..., wrists, :] + beyond * along], axis=-2)


@dataclass(frozen=True, eq=False)
class Targets:
    """Goals as arrays: coordinates of joints in frames, and headings."""

    frames: Int[np.ndarray, " points"]  # Frame of each point.
    # Its joint; numbers beyond the skeleton's are points of hands.
    joints: Int[np.ndarray, " points"]
    # Where it should be, meters; NaN leaves a coordinate free.
    places: Float[np.ndarray, "points 3"]
    turned: Int[np.ndarray, " headings"]  # Frames in which the heading is given.
    headings: Float[np.ndarray, " headings"]  # Radians from +z toward +x.
    # Joint from which a place counts, in the body's directions; -1 for places in the world, which
    # by default all are.
    origins: Int[np.ndarray, " points"] | None = None

    @property
    def fixed(self) -> Bool[np.ndarray, "points 3"]:
        """True on coordinates that are given."""
        return np.isfinite(self.places)

    def gaps(self, joints: Joints, skeleton: Skeleton) -> Float[np.ndarray, "points 3"]:
        """Returns what is missing from each point to its place, meters in the world, 0 if free."""
        points = with_hands(joints, skeleton)
        gaps = np.nan_to_num(self.places - points[self.frames, self.joints])
        if self.origins is None or not (self.origins >= 0).any():
            return gaps
        relative = np.flatnonzero(self.origins >= 0)
        frames = self.frames[relative]
        facing = heading(joints[frames], skeleton)
        away = points[frames, self.joints[relative]] - points[frames, self.origins[relative]]
        missing = np.nan_to_num(self.places[relative] - turn(away, -facing))
        gaps[relative] = turn(missing, facing)
        return gaps


NO_TARGETS = Targets(
    np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), np.zeros(0, int), np.zeros(0)
)


@dataclass(frozen=True, eq=False)
class TargetResidual:
    """Residuals to targets, and their derivatives by the joints."""

    targets: Targets
    skeleton: Skeleton

    def __call__(self, joints: Joints) -> Float[np.ndarray, " rows"]:
        """Returns goal minus joint, meters; a radian of heading counts as 0.3 m."""
        targets = self.targets
        gaps = targets.gaps(joints, self.skeleton)
        if targets.origins is not None:  # in the directions that their coordinates are given in
            gaps = turn(gaps, -self._facing(joints))
        turns = heading_gaps(joints, targets, self.skeleton)
        return np.concatenate([gaps[targets.fixed], _TURN * turns])

    def gradient(self, joints: Joints) -> Float[np.ndarray, "rows frames joints 3"]:
        """Returns the derivatives of these coordinates and headings.

        The directions of a body and of a forearm count as if they did not change.
        """
        targets, names = self.targets, self.skeleton.names
        point, axis = np.nonzero(targets.fixed)
        rows, frames = np.arange(len(point)), targets.frames[point]
        gradient = np.zeros((len(point) + len(targets.turned), *joints.shape))
        along = turn(np.eye(3)[axis], self._facing(joints)[point])
        hands, count = hand_points(self.skeleton), len(names)

        def add(joint: Int[np.ndarray, " rows"], chosen: np.ndarray, sign: float) -> None:
            for row, frame, point in zip(rows[chosen], frames[chosen], joint[chosen], strict=True):
                if point < count:
                    gradient[row, frame, point] += sign * along[row]
                    continue
                hand = hands[point - count]
                forearm = joints[frame, hand.wrist] - joints[frame, hand.elbow]
                share = hand.beyond / max(float(np.linalg.norm(forearm)), 1e-6)
                gradient[row, frame, hand.wrist] += sign * (1 + share) * along[row]
                gradient[row, frame, hand.elbow] -= sign * share * along[row]

        add(targets.joints[point], np.ones(len(point), bool), 1.0)
        if targets.origins is not None:
            add(targets.origins[point], targets.origins[point] >= 0, -1.0)
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
                gradient[row, frame, joint] = sign * slope
        return gradient

    def _facing(self, joints: Joints) -> Float[np.ndarray, " points"]:
        """Returns the direction in which the coordinates of each point are given."""
        targets = self.targets
        if targets.origins is None:
            return np.zeros(len(targets.frames))
        facing = heading(joints[targets.frames], self.skeleton)
        return np.where(targets.origins >= 0, facing, 0.0)


def heading_gaps(
    joints: Joints, targets: Targets, skeleton: Skeleton
) -> Float[np.ndarray, " headings"]:
    """Returns what is missing to each heading, radians from -π to π."""
    turns = targets.headings - heading(joints[targets.turned], skeleton)
    return (turns + np.pi) % (2 * np.pi) - np.pi


def instants(
    goals: Iterable[Goal], frames: int, fps: float, most: int | None = None
) -> list[Reach | Heading]:
    """Returns places of joints and headings of single frames, for goals that may hold longer.

    Args:
        goals: The goals; paths, poses and looks are left out.
        frames: Length of the motion.
        fps: Frames per second.
        most: Most instants of a goal that holds; by default each of its frames.

    Raises:
        InputError: A goal is beyond the motion, or ends before it begins.
    """
    every: list[Reach | Heading] = []
    for goal in goals:
        if not isinstance(goal, Reach | Heading):
            continue
        if goal.until is None:
            every.append(goal)
            continue
        first, last = span_of(goal, frames, fps)
        count = min(most or last - first + 1, last - first + 1)
        chosen = np.unique(np.linspace(first, last, count).round()).tolist()
        every += [replace(goal, at=frame / fps, until=None) for frame in chosen]
    return every


def span_of(goal: Reach | Heading | LookAt | Pose, frames: int, fps: float) -> tuple[int, int]:
    """Returns the first and the last frame of a goal.

    Raises:
        InputError: It is beyond the motion, or ends before it begins.
    """
    first = frame_at(goal.at, frames, fps)
    until = None if isinstance(goal, Pose) else goal.until
    last = first if until is None else frame_at(until, frames, fps)
    if until is not None and until <= goal.at:
        raise InputError(
            f"a goal from {goal.at:g} to {until:g} s: expected an end after its beginning"
        )
    return first, last


def targets_of(
    goals: Iterable[Goal],
    frames: int,
    fps: float,
    skeleton: Skeleton,
    start: tuple[float, float] | None = (0.0, 0.0),
) -> Targets:
    """Returns goals other than paths and looks as arrays, after a check of each.

    Args:
        goals: What is wanted; paths and looks are left out.
        frames: Length of the motion.
        fps: Frames per second.
        skeleton: Names the joints.
        start: Where on the floor the motion starts, x and z; None where goals are checked already.

    Raises:
        InputError: No person could meet a goal, or it is beyond the motion.
    """
    points: list[tuple[int, int, tuple[float, ...], int]] = []
    turns: dict[int, float] = {}
    goals = list(goals)
    places = instants(goals, frames, fps)
    places += [
        place for goal in goals if isinstance(goal, Pose) for place in goal.reaches(skeleton)
    ]
    for goal in places:
        frame = frame_at(goal.at, frames, fps)
        if isinstance(goal, Heading):
            if not np.isfinite(goal.degrees):
                raise InputError(f"heading {goal.degrees}: expected degrees")
            if frame in turns:
                raise InputError(f"two headings at {goal.at:g} s: leave one out")
            turns[frame] = float(np.radians(goal.degrees))
            continue
        to = tuple(np.nan if value is None else float(value) for value in goal.to)
        origin = -1 if goal.relative_to is None else _joint(goal.relative_to, skeleton)
        points.append((frame, _joint(goal.joint, skeleton), to, origin))
    origins = np.array([point[3] for point in points], int)
    targets = Targets(
        np.array([point[0] for point in points], int),
        np.array([point[1] for point in points], int),
        np.array([point[2] for point in points], float).reshape(-1, 3),
        np.array(list(turns), int),
        np.array(list(turns.values()), float),
        origins if (origins >= 0).any() else None,
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
    length, names = _distances(skeleton), _point_names(skeleton)
    origins = np.full(len(targets.frames), -1) if targets.origins is None else targets.origins
    points: set[tuple[int, int]] = set()
    places: dict[tuple[int, int], np.ndarray] = {}
    for frame, joint, place, origin in zip(
        targets.frames, targets.joints, targets.places, origins.tolist(), strict=True
    ):
        key, name, at = (int(frame), int(joint)), names[joint], frame / fps
        if key in points:
            raise InputError(f"two goals for {name} at {at:g} s: leave one out")
        if np.isinf(place).any() or np.isnan(place).all():
            raise InputError(f"goal of {name} at {at:g} s: expected meters for x, y or z")
        points.add(key)
        if origin >= 0:
            apart, bones = float(np.linalg.norm(np.nan_to_num(place))), length[joint, origin]
            if apart > 1.05 * bones + 0.05:
                raise InputError(
                    f"goal of {name} at {at:g} s is {apart:.2f} m from {names[origin]}: the bones "
                    f"between them are {bones:.2f} m long"
                )
            continue
        places[key] = place
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
    ordered = sorted(places.items())
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
    if path.pace is not None:
        paces = np.atleast_1d(np.array(path.pace, float))
        if path.at is not None:
            raise InputError("a path has either times or a pace: leave one out")
        if paces.ndim != 1 or len(paces) not in (1, len(points)):
            raise InputError(f"{len(paces)} paces for {len(points)} points of a path")
        if not (np.isfinite(paces).all() and paces.min() > 0 and paces.max() <= FASTEST):
            raise InputError(
                f"pace {path.pace}: expected meters per second, above 0 and at most {FASTEST:g}"
            )
        return
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


def _point_names(skeleton: Skeleton) -> tuple[str, ...]:
    return (*skeleton.names, *(hand.name for hand in hand_points(skeleton)))


def _joint(name: str, skeleton: Skeleton) -> int:
    numbers = {point: number for number, point in enumerate(_point_names(skeleton))}
    return named("joint", name, numbers)


@lru_cache(maxsize=16)
def _distances(skeleton: Skeleton) -> Float[np.ndarray, "points points"]:
    """Returns the length of the bones between any two joints or points of hands, meters."""
    hands = hand_points(skeleton)
    bones = [*np.linalg.norm(skeleton.offsets, axis=-1), *(hand.beyond for hand in hands)]
    above: list[set[int]] = []
    for joint, parent in enumerate([*skeleton.parents, *(hand.wrist for hand in hands)]):
        above.append({joint} | (above[parent] if parent >= 0 else set()))
    return np.array([[sum(bones[j] for j in first ^ other) for other in above] for first in above])
