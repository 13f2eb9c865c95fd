"""Generation with goals: sampling is corrected, the result is moved to its goals, a path is bent.

    some steps  clean latents ← one update of reach
    at the end  a few more     → joints → bent onto the path

Clean-up comes later, and `at_goals` after it: the joints themselves are put at their goals.

Looks: the head is turned so that the eyes look at a point.

Positions of joints do not show how a head is turned. So they stay, and the motion gets an animation
whose head turns, which every writer of files follows. The head turns from the neck's direction by a
yaw and a pitch that come and go as offsets of joints do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.cleanup.pipeline import ground_path
from latentmotion.control.exact import BLEND, distances, hold_targets, spread
from latentmotion.control.generator import Generator, decoders_of, latents_of, metadata_of
from latentmotion.control.goals import (
    Directed,
    Goal,
    Heading,
    LookAt,
    Pose,
    Reach,
    RootPath,
    TargetResidual,
    check_path,
    frame_at,
    heading_gaps,
    instants,
    span_of,
    targets_of,
)
from latentmotion.control.path import Curve, bent, straight_points, straightened
from latentmotion.control.reach import Correction, DecodedMotion, ReachSettings, Sample, reach
from latentmotion.engine.request import GenerationRequest
from latentmotion.errors import InputError
from latentmotion.kinematics.humanoid import Humanoid
from latentmotion.kinematics.recorded import Recorded
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import Joints, Skeleton
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn

# Updates of the estimate of the clean latents during sampling.
_DURING = ReachSettings(updates=1, checked=False)

# Steps of the sampler of which the second, the sixth and so on move its estimate: the first one's
# is so vague that its Jacobian is of little use, and later ones keep what an earlier one has
# done.
_EVERY = 4

# Updates of the latents after sampling.
_AFTER = ReachSettings(updates=8, tolerance=5e-4)

# Meters and degrees by which a cleaned motion may be off its goal before it is put there.
_MOST_REPAIR, _MOST_DEGREES = 0.15, 30.0

# Mean jerk of the joints, m/s³, in so many seconds: 99 of 100 recordings of CMU, SNU and HDM05
# stay below it in their jerkiest half second.
_MOST_JERK, _WINDOW = 635.0, 0.5

# Joints by which sampling is directed to a pose; the others follow by their bones.
_ENDS = ("pelvis", "head", "shoulder", "wrist", "knee", "ankle")

# Updates of the latents after sampling where there are poses, which latents do not meet exactly;
# what is left is as much after more, and less damping makes the motion jerk. Moving the estimates
# during sampling, too, gains nothing there, and one Jacobian serves for all updates.
_POSED = ReachSettings(updates=3, tolerance=5e-3, damping=0.1, keeps=1.0)

# Instants at which sampling is directed to a goal that holds: one in so many seconds.
_MOST_INSTANTS, _SPACING = 12, 0.3


@dataclass(frozen=True, eq=False)
class Direction:
    """Goals of one motion, checked: on the floor of the world, and along a straight line."""

    skeleton: Skeleton  # Names the joints.
    fps: float  # Frames per second.
    frames: int  # Length of the motion.
    in_world: tuple[Directed, ...]  # Goals in the world, as they were given, without the path.
    curve: Curve | None = None  # The path, onto which the motion is bent.
    # When the pelvis has to be how far along the path: seconds and meters.
    along: tuple[tuple[float, float], ...] = ()

    @property
    def goals(self) -> tuple[Directed, ...]:
        """All goals in the world, those of a path as places of the pelvis."""
        if self.curve is None:
            return self.in_world
        passed = [
            (at, self.curve.place(np.array(meters), np.array(0.0)).tolist())
            for at, meters in self.along[1:]
        ]
        return (*self.in_world, *(Reach("pelvis", at, (x, None, z)) for at, (x, z) in passed))

    def residual(self, joints: Joints | None = None) -> TargetResidual:
        """Returns what is missing, where the path of the motion is straight.

        Args:
            joints: A straight motion that says where the body is at the goals beside its path; by
                default it is on the path, at an even speed.
        """
        goals: list[Goal] = []
        for goal in self.in_world:
            if isinstance(goal, Pose):
                places = goal.reaches(self.skeleton)
                few = [place for place in places if place.joint.endswith(_ENDS)]
                goals += few or places
                continue
            held = (getattr(goal, "until", None) or goal.at) - goal.at
            most = min(_MOST_INSTANTS, 2 + int(held / _SPACING))
            goals += instants([goal], self.frames, self.fps, most)
        if self.curve is not None:
            onto = [Reach("pelvis", at, (0.0, None, meters)) for at, meters in self.along[1:]]
            goals = [*(self._straight(goal, self.curve, joints) for goal in goals), *onto]
        targets = targets_of(goals, self.frames, self.fps, self.skeleton, None)
        return TargetResidual(targets, self.skeleton)

    def _straight(self, goal: Goal, curve: Curve, joints: Joints | None) -> Goal:
        """Returns a goal of the world as it is on the straight line."""
        assert isinstance(goal, Reach | Heading)
        even = float(np.interp(goal.at, *np.transpose(self.along)))
        pelvis, along = (0.0, even), even
        if joints is not None:
            frame = frame_at(goal.at, self.frames, self.fps)
            pelvis = float(joints[frame, 0, 0]), float(joints[frame, 0, 2])
            along = float(ground_path(joints, self.fps)[frame, 2])
        if isinstance(goal, Heading):
            turned = float(np.degrees(curve.direction(np.array(along))))
            return replace(goal, degrees=goal.degrees - turned)
        if goal.relative_to is not None:  # to the body, which turns with the path
            return goal
        x, y, z = goal.to
        if x is None or z is None:
            raise InputError(
                f"goal of {goal.joint} at {goal.at:g} s leaves x or z free: beside a path it needs "
                "both"
            )
        height = np.nan if y is None else y
        ahead = straightened((x, height, z), pelvis, along, curve)
        return replace(goal, to=(ahead[0], y, ahead[2]))


def generate_directed(
    generator: Generator, request: GenerationRequest, goals: Sequence[Goal]
) -> tuple[Motion, tuple[Directed, ...]]:
    """Generates the one motion of a request with goals, one raw take.

    Returns:
        The motion, not cleaned up, and the goals at which `at_goals` puts its joints once it is.

    Raises:
        InputError: No person could meet a goal, or goals contradict each other.
        ModelError: The model has no pullback.
    """
    (frames,), (prompt,), (seed,) = request.frames, request.prompts, request.seeds
    motion, space = decoders_of(generator)(frames), generator.representation
    # A motion starts above the origin and faces +z; a pose in which it starts may be elsewhere.
    poses = [goal for goal in goals if isinstance(goal, Pose) and goal.at < 0.5 / goal.motion.fps]
    free = [goal for goal in goals if isinstance(goal, Reach) and not goal.relative_to]
    half = any((goal.to[0] is None) != (goal.to[2] is None) for goal in free)
    alike = len(poses) == 1 and poses[0].motion.skeleton.names == space.skeleton.names
    place, yaw = np.zeros(3), 0.0
    if alike and not half and not any(isinstance(goal, RootPath) for goal in goals):
        first = poses[0].motion.joints[poses[0].frame].astype(np.float64)
        place, yaw = first[0] * (1, 0, 1), float(heading(first, space.skeleton))
    local = [_seen_from(goal, place, yaw) for goal in goals]
    direction = direction_of(local, frames, space.fps, space.skeleton)
    moved = directed(direction, motion, latents_of(generator, request), space.fps)
    about = {**metadata_of(generator, seed, request.sampling), **moved.metadata}
    moved = replace(moved, caption=prompt, metadata=about)
    if local == [*goals]:
        return moved, direction.goals
    joints = turn(moved.joints.astype(np.float64), np.array(yaw)) + place
    world = tuple(goal for goal in goals if not isinstance(goal, RootPath))
    return replace(moved, joints=joints.astype(np.float32)), world


def _seen_from(goal: Goal, place: Float[np.ndarray, " 3"], yaw: float) -> Goal:
    """Returns a goal as it is seen from a place and a heading."""
    if (yaw == 0 and not place.any()) or isinstance(goal, RootPath):
        return goal
    if isinstance(goal, Pose):
        joints = turn(goal.motion.joints.astype(np.float64) - place, np.array(-yaw))
        return replace(
            goal, motion=Motion(joints.astype(np.float32), skeleton=goal.motion.skeleton)
        )
    if isinstance(goal, Heading):
        return replace(goal, degrees=goal.degrees - float(np.degrees(yaw)))
    if isinstance(goal, Reach) and goal.relative_to is not None:
        return goal
    x, y, z = goal.to
    there = turn(np.array([x or 0.0, y or 0.0, z or 0.0]) - place, np.array(-yaw)).tolist()
    to = tuple(None if old is None else new for old, new in zip(goal.to, there, strict=True))
    return replace(goal, to=to)


def directed(direction: Direction, motion: DecodedMotion, sample: Sample, fps: float) -> Motion:
    """Generates a motion with goals; clean it up, and `at_goals` puts its joints exactly there.

    Args:
        direction: The goals.
        motion: The motion as a function of its latents.
        sample: Samples latents.
        fps: Frames per second.
    """
    residual, skeleton = direction.residual(), direction.skeleton
    correction, steps = Correction(motion, residual, settings=_DURING), count()
    posed = any(isinstance(goal, Pose) for goal in direction.in_world)
    after, turns = _POSED if posed else _AFTER, () if posed else (1,)
    z = sample(motion.frames, lambda z: correction(z) if next(steps) % _EVERY in turns else z)
    z = reach(np.asarray(z, np.float64), motion, residual, settings=after)
    joints = motion.joints(z)
    if direction.curve is not None and direction.in_world:
        # Now it is known where beside its path the body is when it has other goals.
        z = reach(z, motion, direction.residual(joints), settings=after)
        joints = motion.joints(z)
    if direction.curve is not None:
        joints = bent(joints, direction.curve, fps, skeleton)
    moved = Motion(joints.astype(np.float32), fps, skeleton)
    return replace(moved, metadata=goal_report(direction.goals, moved, moved))


def direction_of(goals: Sequence[Goal], frames: int, fps: float, skeleton: Skeleton) -> Direction:
    """Checks goals and returns what they mean for a motion of so many frames.

    Raises:
        InputError: No person could meet a goal, or goals contradict each other.
    """
    for goal in goals:
        if not isinstance(goal, Goal):
            expected = "RootPath, Reach, Heading, LookAt or Pose of latentmotion"
            raise InputError(f"a goal is {goal!r}; expected {expected}")
    paths = [goal for goal in goals if isinstance(goal, RootPath)]
    if len(paths) > 1:
        raise InputError(f"{len(paths)} paths for one motion: join their points to one")
    others = tuple(goal for goal in goals if not isinstance(goal, RootPath))
    for goal in others:
        span_of(goal, frames, fps)  # raises an error where the motion is too short
    if not paths:
        direction, start = Direction(skeleton, fps, frames, others), (0.0, 0.0)
    else:
        (path,) = paths
        check_path(path, frames, fps)
        curve = Curve.through(path)
        times, meters = straight_points(path, curve, frames, fps)
        along = tuple(zip(times.tolist(), meters.tolist(), strict=True))
        direction = Direction(skeleton, fps, frames, others, curve, along)
        start = float(path.points[0][0]), float(path.points[0][1])
        direction.residual()
    targets_of(direction.goals, frames, fps, skeleton, start)
    return direction


def at_goals(cleaned: Motion, goals: Sequence[Directed]) -> Motion:
    """Returns a motion that was cleaned up, its joints, body and head exactly at their goals."""
    fps, skeleton = cleaned.fps, cleaned.skeleton
    targets = targets_of(goals, len(cleaned), fps, skeleton, None)
    joints = hold_targets(cleaned.joints.astype(np.float64), targets, fps, skeleton)
    exact = replace(cleaned, joints=joints.astype(np.float32))
    looks = [goal for goal in goals if isinstance(goal, LookAt)]
    exact = looking(exact, looks) if looks else exact
    about = {**cleaned.metadata, **goal_report(goals, cleaned, exact)}
    exact = replace(exact, metadata=about).with_recorded(exact.recorded)
    violation = unmet(exact)
    return (
        exact if violation is None else replace(exact, metadata={**about, "violation": violation})
    )


def goal_report(goals: Sequence[Directed], before: Motion, after: Motion) -> dict[str, object]:
    """Returns how far a motion is from its goals, an entry for each, and how fast feet slide.

    `before` and `after` are meters of the joint that is farthest off while the goal holds, or, with
    the unit `degrees`, those of a heading or of the direction in which the eyes look.

    Args:
        goals: What was asked.
        before: The motion before it was put at its goals.
        after: The same after it.
    """
    entries = []
    for goal in goals:
        was, now = (_missed(goal, motion) for motion in (before, after))
        if isinstance(goal, Pose):
            entry: dict[str, object] = {"pose": goal.frame, "at": goal.at}
        else:
            entry = {key: value for key, value in vars(goal).items() if value is not None}
        if isinstance(goal, Reach):
            entry["to"] = list(goal.to)
        if isinstance(goal, LookAt):
            del entry["to"]
            entry["look_at"] = list(goal.to)
        if isinstance(goal, Heading | LookAt):
            entry["unit"] = "degrees"
        entries.append({**entry, "before": was, "after": now})
    return {"goals": entries, "foot_sliding": sliding_in_contact(after)}


def _missed(goal: Directed, motion: Motion) -> float:
    """Returns how far a motion is from a goal: meters, or degrees of a heading or a look."""
    if isinstance(goal, LookAt):
        return missed_looks(motion, goal)
    joints, skeleton = motion.joints.astype(np.float64), motion.skeleton
    targets = targets_of([goal], len(motion), motion.fps, skeleton, None)
    if isinstance(goal, Heading):
        return float(np.degrees(np.abs(heading_gaps(joints, targets, skeleton)).max()))
    return float(distances(joints, targets, skeleton).max())


def unmet(motion: Motion) -> str | None:
    """Returns which goal a motion meets by flying or breaking, and why; None where it is fine.

    Args:
        motion: Cleaned up and put at its goals.
    """
    goals = [goal for goal in motion.metadata.get("goals", ()) if "look_at" not in goal]
    if not goals:
        return None
    most = [_MOST_DEGREES if "unit" in goal else _MOST_REPAIR for goal in goals]
    over = [goal["before"] / limit for goal, limit in zip(goals, most, strict=True)]
    worst = goals[int(np.argmax(over))]
    if max(over) > 1:
        before = f"{worst['before']:.0f}°" if "unit" in worst else f"{1e2 * worst['before']:.0f} cm"
        return f"{named(worst)} was {before} away before it was put there"
    jerk = np.linalg.norm(np.diff(motion.joints.astype(np.float64), n=3, axis=0), axis=-1).mean(-1)
    window = max(1, min(round(_WINDOW * motion.fps), len(jerk)))
    mean = np.convolve(jerk, np.ones(window) / window, "valid") * motion.fps**3
    if len(jerk) < window or mean.max() <= _MOST_JERK:
        return None
    at = (int(mean.argmax()) + (window + 3) / 2) / motion.fps
    nearest = min(goals, key=lambda goal: abs(goal["at"] - at))
    return f"{named(nearest)} makes the body jerk by {mean.max():.0f} m/s³ at {at:.1f} s"


def named(goal: Mapping[str, Any]) -> str:
    """Returns the name and the time of an entry of a goal report."""
    kinds = {"pose": "pose", "degrees": "heading", "look_at": "eyes"}
    name = goal.get("joint") or next(kinds[kind] for kind in kinds if kind in goal)
    until = f" to {round(goal['until'], 2):g}" if "until" in goal else ""
    return f"{name} at {round(goal['at'], 2):g}{until} s"


def sliding_in_contact(motion: Motion) -> float:
    """Returns the mean horizontal speed of feet while they stand, meters per second."""
    feet, slowest = motion.skeleton.left_foot, []
    if not feet or len(motion) < 2:
        return 0.0
    joints = motion.joints.astype(np.float64)
    contacts = foot_contacts(joints, motion.fps, motion.skeleton)
    sides = (feet, contacts[:, : len(feet)]), (motion.skeleton.right_foot, contacts[:, len(feet) :])
    for foot, standing in sides:
        steps = np.diff(joints[:, list(foot)], axis=0)[..., ::2]
        speed = np.linalg.norm(steps, axis=-1) * motion.fps
        both = standing[1:] & standing[:-1]
        # A foot that rolls stands with one of its joints.
        slowest.append(np.where(both, speed, np.inf).min(axis=1)[both.any(axis=1)])
    speeds = np.concatenate(slowest)
    return float(speeds.mean()) if len(speeds) else 0.0


# Meters from the head's joint to between the eyes, in the head's axes.
_EYES = np.array([0.0, 0.07, 0.09])

# Yaw and pitch up to which neck and head turn together.
_FARTHEST = np.radians([80.0, 60.0])

# Rounds in which the place of the eyes and the direction of the head settle.
_ROUNDS = 6


def looking(motion: Motion, looks: Sequence[LookAt]) -> Motion:
    """Returns the motion with a head that turns to points; the positions of joints are the same.

    Args:
        motion: A motion of a skeleton with a head.
        looks: Where the eyes look, and when.

    Raises:
        InputError: Two looks are at one time.
    """
    animation, skeleton = motion.animation(), motion.skeleton
    head = skeleton.names.index("head")
    world = skeleton.world_rotations(animation.rotations)
    angles: dict[int, np.ndarray] = {}
    for look in looks:
        first, last = span_of(look, len(motion), motion.fps)
        for frame in range(first, last + 1):
            if frame in angles:
                raise InputError(f"two looks at {frame / motion.fps:g} s: leave one out")
            away = np.array(look.to) - motion.joints[frame, head].astype(np.float64)
            angle = np.zeros(2)  # yaw and pitch by which the eyes come to look at the point
            for _ in range(_ROUNDS):
                x, y, z = world[frame, head].T @ away - _turned(angle[:1], angle[1:])[0] @ _EYES
                goal = np.array([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))])
                angle = np.clip(goal, -_FARTHEST, _FARTHEST)
            angles[frame] = np.append(angle, 0.0)
    yaw, pitch, _ = spread(angles, len(motion), BLEND * motion.fps).T
    world[:, head] = world[:, head] @ _turned(yaw, pitch)
    turned = replace(animation, rotations=skeleton.local_rotations(world))
    names = {name: joint for joint, name in enumerate(skeleton.names)}
    return replace(motion).with_recorded(Recorded(turned, Humanoid(animation.skeleton, names)))


def missed_looks(motion: Motion, look: LookAt) -> float:
    """Returns by how many degrees the eyes look past a point, the most while the look holds."""
    head = motion.skeleton.names.index("head")
    world = motion.skeleton.world_rotations(motion.animation().rotations)[:, head]
    first, last = span_of(look, len(motion), motion.fps)
    frames = slice(first, last + 1)
    eyes = motion.joints[frames, head] + world[frames] @ _EYES
    way = np.array(look.to) - eyes
    along = (world[frames, :, 2] * way).sum(axis=-1) / np.linalg.norm(way, axis=-1)
    return float(np.degrees(np.arccos(np.clip(along, -1, 1)).max()))


def _turned(
    yaw: Float[np.ndarray, "*batch"], pitch: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 3 3"]:
    """Returns the rotations by a yaw toward the left, then a pitch upward."""
    about_y, about_x = (np.zeros((*np.shape(yaw), 3)) for _ in range(2))
    about_y[..., 1], about_x[..., 0] = yaw, -np.asarray(pitch)
    return matrix_from_axis_angle(about_y) @ matrix_from_axis_angle(about_x)
