"""How good joints → rotations is, against the shortest arc from a rest direction that is usual.

    python -m benchmarks.quality.rotations PREPARED_FOLDER  # lab/diary/cleanup.md

Bones are compared by their rotation in the world. A bone's *reason* to turn in a step is the
largest angular speed of its own direction and of those of the bones within two bones of its upper
end. It spins without reason where it turns faster than a limit and more than twice its reason.

    ours       latentmotion.kinematics.inverse_kinematics
    shortest   the shortest arc from each bone's rest direction, in the world (HumanML3D's features)
    chain      the shortest arc from the parent's rotation, the root turned by the hips
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from benchmarks.quality.starter_motions import starter_motions
from latentmotion.data.dataset import Dataset
from latentmotion.kinematics.inverse_kinematics import solve
from latentmotion.kinematics.rotations import (
    axis_angle_from_matrix,
    matrix_from_axis_angle,
    matrix_from_quaternion,
    quaternion_between,
)
from latentmotion.kinematics.skeleton import HUMANML3D, HUMANML3D_DIRECTIONS, Animation

PARENTS = [max(parent, 0) for parent in HUMANML3D.parents]
REST = np.array(HUMANML3D_DIRECTIONS, dtype=np.float64)
LIMITS = (5.0, 10.0)  # Radians per second.

Joints = Float[np.ndarray, "frames joints 3"]
Rotations = Float[np.ndarray, "frames joints 3 3"]


@dataclass(frozen=True)
class Turns:
    """Speeds of every bone in every step, rad/s."""

    speed: Float[np.ndarray, "steps bones"]  # Of its whole rotation.
    reason: Float[np.ndarray, "steps bones"]  # Of the directions of it and its neighbors.

    def without_reason(self, limit: float) -> int:
        """Counts bones and steps that spin without reason."""
        return int(((self.speed > limit) & (self.speed > 2 * self.reason)).sum())


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", help="prepared folder")
    dataset = Dataset.load(parser.parse_args().data)
    fps = dataset.representation.fps
    sets = {"real": _clips(dataset), "starter": starter_motions(dataset)}
    print(
        "| motions | solution | > 5 rad/s | > 10 rad/s | > half a turn / 0.1 s | fastest, rad/s |"
    )
    print("|---|---|---|---|---|---|")
    for name, motions in sets.items():
        for solution, rotations in SOLUTIONS.items():
            print(_row(name, solution, [turns(j, rotations(j, fps), fps) for j in motions]))
    print()
    for name, motions in sets.items():
        print(_fit(name, motions, fps))


def _clips(dataset: Dataset) -> list[Joints]:
    clips = [clip for split in ("train", "val", "test") for clip in dataset.clips(split)]
    return [dataset.representation.decode(dataset.features(clip)) for clip in clips]


def _row(name: str, solution: str, found: list[Turns]) -> str:
    counts = [sum(t.without_reason(limit) for t in found) for limit in LIMITS]
    half = sum(int((t.speed > 10 * np.pi).sum()) for t in found)
    fastest = max(float(t.speed.max(initial=0)) for t in found)
    return (
        f"| {len(found)} {name} | {solution} | {counts[0]} | {counts[1]} | {half} | {fastest:.0f} |"
    )


def _fit(name: str, motions: list[Joints], fps: float) -> str:
    """Says how well forward kinematics gives the joints again, and how long solving took."""
    start = time.process_time()
    animations = [solve(joints, fps) for joints in motions]
    seconds = (time.process_time() - start) / sum(len(joints) for joints in motions)
    moving = _misses(animations, motions)
    rigid = _misses([replace(a, translations=None) for a in animations], motions)
    return (
        f"{name}: forward kinematics off by {moving}; by {rigid} where pelvis and chest do not "
        f"bend; {196e3 * seconds:.0f} ms of one core for 196 frames"
    )


def _misses(animations: list[Animation], motions: list[Joints]) -> str:
    errors = [
        np.linalg.norm(animation.joints() - joints, axis=-1)
        for animation, joints in zip(animations, motions, strict=True)
    ]
    mean = float(np.concatenate([error.ravel() for error in errors]).mean())
    return f"{1000 * mean:.3f} mm on average, {1000 * max(e.max() for e in errors):.2f} mm at most"


def turns(joints: Joints, bones: Rotations, fps: float) -> Turns:
    """Measures how fast bones turn, and what reason they have."""
    steps = np.swapaxes(bones[:-1, 1:], -1, -2) @ bones[1:, 1:]
    directions = _unit(joints - joints[:, PARENTS])
    across = np.linalg.norm(np.cross(directions[:-1], directions[1:]), axis=-1)
    along = (directions[:-1] * directions[1:]).sum(-1)
    swings = np.arctan2(across, along)
    reason = [swings[:, near].max(axis=1) for near in map(_near, range(1, len(PARENTS)))]
    speed = np.linalg.norm(axis_angle_from_matrix(steps), axis=-1)
    return Turns(speed * fps, np.stack(reason, axis=1) * fps)


def _near(joint: int) -> list[int]:
    """Returns the bones, by their lower joints, within two bones of a bone's upper end."""
    reached = {PARENTS[joint]}
    for _ in range(2):
        reached |= {j for j, p in enumerate(PARENTS) if p in reached} | {
            PARENTS[j] for j in reached
        }
    return [j for j, p in enumerate(PARENTS) if j and j in reached and p in reached]


def _ours(joints: Joints, fps: float) -> Rotations:
    world: list[Float[np.ndarray, "frames 3 3"]] = []
    animation = solve(joints, fps)
    for joint, parent in enumerate(HUMANML3D.parents):
        local = animation.rotations[:, joint]
        world.append(local if parent < 0 else world[parent] @ local)
    return np.stack([world[parent] for parent in PARENTS], axis=1)


def _shortest(joints: Joints, fps: float) -> Rotations:
    return _between(np.broadcast_to(REST, joints.shape), joints - joints[:, PARENTS])


def _chain(joints: Joints, fps: float) -> Rotations:
    bones, world = joints - joints[:, PARENTS], [_heading(joints)]
    for joint, parent in list(enumerate(PARENTS))[1:]:
        carried = world[parent] @ REST[joint]
        world.append(_between(carried, bones[:, joint]) @ world[parent])
    return np.stack(world, axis=1)


def _heading(joints: Joints) -> Float[np.ndarray, "frames 3 3"]:
    x, _, z = np.moveaxis(joints[:, 1] - joints[:, 2], -1, 0)
    yaw = np.arctan2(-z, x)
    return matrix_from_axis_angle(np.stack([0 * yaw, yaw, 0 * yaw], axis=-1))


def _between(a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*n 3"]) -> np.ndarray:
    return matrix_from_quaternion(quaternion_between(a, b))


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


SOLUTIONS: dict[str, Callable[[Joints, float], Rotations]] = {
    "ours": _ours,
    "shortest arc": _shortest,
    "shortest arc from parent": _chain,
}


if __name__ == "__main__":
    main()
