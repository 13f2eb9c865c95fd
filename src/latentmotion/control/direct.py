"""Generation with goals: sampling is corrected, the result is moved to its goals, a path is bent.

    some steps  clean latents ← one update of reach
    at the end  a few more     → joints → bent onto the path

Clean-up comes later, and `at_goals` after it: the joints themselves are put at their goals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.contacts import foot_contacts
from latentmotion.cleanup.pipeline import ground_path
from latentmotion.control.exact import distances, hold_targets
from latentmotion.control.generator import Generator, decoders_of, latents_of, metadata_of
from latentmotion.control.goals import (
    Goal,
    Heading,
    Pose,
    Reach,
    RootPath,
    TargetResidual,
    check_path,
    frame_at,
    targets_of,
)
from latentmotion.control.path import Curve, bent, straight_points, straightened
from latentmotion.control.reach import (
    Correction,
    DecodedMotion,
    ReachSettings,
    Sample,
    reach,
)
from latentmotion.engine.request import GenerationRequest
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.motion import Motion

_DURING = ReachSettings(updates=1, checked=False)
"""Updates of the estimate of the clean latents during sampling."""

_EVERY = 4
"""Steps of the sampler of which the second, the sixth and so on move its estimate: the first one's
is so vague that its Jacobian is of little use, and later ones keep what an earlier one has done."""

_AFTER = ReachSettings(updates=8, tolerance=5e-4)
"""Updates of the latents after sampling."""


@dataclass(frozen=True, eq=False)
class Direction:
    """Goals of one motion, checked: on the floor of the world, and along a straight line."""

    skeleton: Skeleton
    """Names the joints."""
    fps: float
    """Frames per second."""
    frames: int
    """Length of the motion."""
    places: tuple[Reach, ...]
    """Places of joints in the world, those of a path left out."""
    headings: tuple[Heading, ...]
    """Directions of the body in the world."""
    curve: Curve | None = None
    """The path, onto which the motion is bent."""
    along: tuple[tuple[float, float], ...] = ()
    """When the pelvis has to be how far along the path: seconds and meters."""

    @property
    def goals(self) -> tuple[Reach, ...]:
        """All places of joints in the world."""
        if self.curve is None:
            return self.places
        passed = [
            (at, self.curve.place(np.array(meters), np.array(0.0)).tolist())
            for at, meters in self.along[1:]
        ]
        return (*self.places, *(Reach("pelvis", at, (x, None, z)) for at, (x, z) in passed))

    def residual(
        self, joints: Float[np.ndarray, "frames joints 3"] | None = None
    ) -> TargetResidual:
        """Returns what is missing, where the path of the motion is straight.

        Args:
            joints: A straight motion that says where the body is at the goals beside its path; by
                default it is on the path, at an even speed.
        """
        goals: list[Goal] = [*self.places, *self.headings]
        if self.curve is not None:
            onto = [Reach("pelvis", at, (0.0, None, meters)) for at, meters in self.along[1:]]
            goals = [*(self._straight(goal, self.curve, joints) for goal in goals), *onto]
        targets = targets_of(goals, self.frames, self.fps, self.skeleton, None)
        return TargetResidual(targets, self.skeleton)

    def _straight(
        self, goal: Goal, curve: Curve, joints: Float[np.ndarray, "frames joints 3"] | None
    ) -> Goal:
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
) -> tuple[Motion, tuple[Reach, ...]]:
    """Generates the one motion of a request with goals, one raw take.

    Returns:
        The motion, not cleaned up, and the places at which `at_goals` puts its joints once it is.

    Raises:
        InputError: No person could meet a goal, or goals contradict each other.
        ModelError: The model has no pullback.
    """
    (frames,), (prompt,), (seed,) = request.frames, request.prompts, request.seeds
    motion, space = decoders_of(generator)(frames), generator.representation
    direction = direction_of(goals, frames, space.fps, space.skeleton)
    made = directed(direction, motion, latents_of(generator, request), space.fps)
    about = {**metadata_of(generator, seed, request.sampling), **made.metadata}
    return replace(made, caption=prompt, metadata=about), direction.goals


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
    z = sample(motion.frames, lambda z: correction(z) if next(steps) % _EVERY == 1 else z)
    z = reach(np.asarray(z, np.float64), motion, residual, settings=_AFTER)
    joints = motion.joints(z)
    if direction.curve is not None and (direction.places or direction.headings):
        # Now it is known where beside its path the body is when it has other goals.
        z = reach(z, motion, direction.residual(joints), settings=_AFTER)
        joints = motion.joints(z)
    if direction.curve is not None:
        joints = bent(joints, direction.curve, fps, skeleton)
    made = Motion(joints.astype(np.float32), fps, skeleton)
    return replace(made, metadata=goal_report(direction.goals, made, made))


def direction_of(goals: Sequence[Goal], frames: int, fps: float, skeleton: Skeleton) -> Direction:
    """Checks goals and returns what they mean for a motion of so many frames.

    Raises:
        InputError: No person could meet a goal, or goals contradict each other.
    """
    for goal in goals:
        if not isinstance(goal, Goal):
            known = "RootPath, Reach, Heading or Pose of latentmotion"
            raise InputError(f"a goal is {goal!r}; expected {known}")
    paths = [goal for goal in goals if isinstance(goal, RootPath)]
    if len(paths) > 1:
        raise InputError(f"{len(paths)} paths for one motion: join their points to one")
    others = [goal for goal in goals if not isinstance(goal, RootPath)]
    places = tuple(
        place
        for goal in others
        for place in (goal.reaches(skeleton) if isinstance(goal, Pose) else [goal])
        if isinstance(place, Reach)
    )
    headings = tuple(goal for goal in others if isinstance(goal, Heading))
    if not paths:
        direction, start = Direction(skeleton, fps, frames, places, headings), (0.0, 0.0)
    else:
        (path,) = paths
        check_path(path, frames, fps)
        curve = Curve.through(path)
        times, meters = straight_points(path, curve, frames, fps)
        along = tuple(zip(times.tolist(), meters.tolist(), strict=True))
        direction = Direction(skeleton, fps, frames, places, headings, curve, along)
        start = float(path.points[0][0]), float(path.points[0][1])
        direction.residual()
    targets_of([*direction.goals, *headings], frames, fps, skeleton, start)
    return direction


def at_goals(cleaned: Motion, goals: Sequence[Reach]) -> Motion:
    """Returns a motion that was cleaned up, its joints exactly at their goals."""
    fps, skeleton = cleaned.fps, cleaned.skeleton
    targets = targets_of(goals, len(cleaned), fps, skeleton, None)
    joints = hold_targets(cleaned.joints.astype(np.float64), targets, fps, skeleton)
    exact = replace(cleaned, joints=joints.astype(np.float32))
    return replace(exact, metadata={**cleaned.metadata, **goal_report(goals, cleaned, exact)})


def goal_report(goals: Sequence[Reach], before: Motion, after: Motion) -> dict[str, object]:
    """Returns how far joints are from their goals, and how fast feet that stand slide.

    Args:
        goals: Where joints should be.
        before: The motion before it was put at its goals.
        after: The same after it.
    """
    targets = targets_of(goals, len(after), after.fps, after.skeleton, None)
    missed = zip(
        goals,
        distances(before.joints, targets).tolist(),
        distances(after.joints, targets).tolist(),
        strict=True,
    )
    report = [
        {"joint": goal.joint, "at": goal.at, "to": list(goal.to), "before": was, "after": now}
        for goal, was, now in missed
    ]
    return {"goals": report, "foot_sliding": sliding_in_contact(after)}


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
