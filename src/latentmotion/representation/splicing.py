"""Two motions → one, joined at a frame where their poses are alike.

The second is turned and moved on the floor so that its first pose lies on the last of the first,
feet that stand above all. What remains of the difference in place and speed fades within half a
second ("inertialization", Bollo 2018, Game Developers Conference): per coordinate the quintic

    x(0) = x₀,  x'(0) = v₀,  x''(0) = 0,  x(T) = x'(T) = x''(T) = 0.

Bones then get their lengths back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from latentmotion.kinematics.skeleton import Joints, Skeleton
from latentmotion.representation.canonical import heading, turn
from latentmotion.representation.interface import Representation

# Meters and meters per second below which a foot joint counts as standing at the seam.
_STANDING_HEIGHT, _STANDING_SPEED = 0.07, 0.4

# Weight of a standing foot joint beside other joints where motions are aligned.
_STANDING_WEIGHT = 20.0


@dataclass(frozen=True)
class Seam:
    """Quality of a seam between two motions."""

    slide: float  # Mean horizontal speed of foot joints on the floor in the transition, m/s.
    jerk: float  # Largest jerk of any joint in the transition, m/s³.
    lowest: float  # Height of the lowest joint in the transition, meters.


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
    fitted: bool = True,
) -> Float[np.ndarray, "total joints 3"]:
    """Returns the first motion up to its last frame, which is the second's first from then on.

    Args:
        first: Positions, meters; at least three frames.
        second: Positions; at least three frames.
        seconds: Length of the transition.
        representation: Frame rate, skeleton and the lengths of bones.
        fitted: Whether bones get these lengths in the transition.

    Returns:
        `len(first) + len(second) - 1` frames; the first `len(first) - 1` are the first's own.
    """
    fps, skeleton = representation.fps, representation.skeleton
    first, second = first.astype(np.float64), second.astype(np.float64)
    # The second is turned and moved so that its first pose lies on the first's last one, its
    # standing feet most of all.
    goal, pose = first[-1], second[0]
    weights = np.ones(len(skeleton))
    leaving, arriving = first[-1] - first[-2], second[1] - second[0]
    for joint in (*skeleton.left_foot, *skeleton.right_foot):
        ends = leaving[joint], arriving[joint]
        low = max(goal[joint, 1], pose[joint, 1]) < _STANDING_HEIGHT
        if low and max(np.linalg.norm(step) * fps for step in ends) < _STANDING_SPEED:
            weights[joint] = _STANDING_WEIGHT
    weights /= weights.sum()
    centers = [weights @ joints for joints in (goal, pose)]
    (ax, _, az), (bx, _, bz) = (
        (joints - c).T for joints, c in zip((goal, pose), centers, strict=True)
    )
    angle = np.arctan2(weights @ (ax * bz - az * bx), weights @ (ax * bx + az * bz))
    move = centers[0] - turn(centers[1], angle)
    second = turn(second, angle) + move * np.array([1.0, 0.0, 1.0])
    offset = first[-1] - second[0]
    speed = leaving - (second[1] - second[0])
    frames = min(round(seconds * fps), len(second) - 1)
    s = (np.arange(frames) / frames)[:, None, None]
    # Quintic: offset, velocity and acceleration are continuous at both ends (Bollo 2018).
    from_offset = 1 - 10 * s**3 + 15 * s**4 - 6 * s**5
    from_speed = s - 6 * s**3 + 8 * s**4 - 3 * s**5
    fading = offset * from_offset + speed * frames * from_speed
    second[: len(fading)] += fading
    if fitted:
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
