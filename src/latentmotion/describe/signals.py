"""Curves over time that all measurements share: heading, speed, heights, the body's own frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.describe.facts import FPS
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.representation.canonical import gaussian_smooth

JOINT = {name: index for index, name in enumerate(HUMANML3D.names)}
"""Index of each joint by name."""

STANDING = 0.92
"""Meters from the floor to the pelvis of HumanML3D's body when it stands."""

MIN_FRAMES = 4


@dataclass(frozen=True, eq=False)
class Signals:
    """Curves of one motion, 20 frames per second, meters, radians; the floor is at zero."""

    joints: Float[np.ndarray, "frames 22 3"]
    """Joint positions above the floor."""
    local: Float[np.ndarray, "frames 22 3"]
    """The same as the body sees it: x to its left, y above the floor, z ahead of the pelvis."""
    heading: Float[np.ndarray, " frames"]
    """Where the hips face, without jumps of a full turn; left is positive."""
    velocity: Float[np.ndarray, "frames 2"]
    """Of the pelvis to its left and ahead, m/s, without the sway of single steps."""
    tilt: Float[np.ndarray, " frames"]
    """Degrees of the trunk away from upright."""
    lean: Float[np.ndarray, " frames"]
    """Degrees by which the trunk leans forward; negative is backward."""
    feet: Float[np.ndarray, "frames 2"]
    """Height of the lowest joint of the left and right foot above where it stands."""

    @property
    def frames(self) -> int:
        """Length."""
        return len(self.joints)

    @property
    def speed(self) -> Float[np.ndarray, " frames"]:
        """Of the pelvis over the floor, m/s."""
        return np.linalg.norm(self.velocity, axis=1)

    def of(self, name: str) -> Float[np.ndarray, "frames 3"]:
        """Returns a joint as the body sees it."""
        return self.local[:, JOINT[name]]


def measure(joints: Float[np.ndarray, "frames joints 3"]) -> Signals:
    """Computes the curves.

    Raises:
        InputError: The joints are no motion of HumanML3D's skeleton.
    """
    joints = np.asarray(joints, np.float64)
    if joints.ndim != 3 or joints.shape[1:] != (22, 3) or len(joints) < MIN_FRAMES:
        raise InputError(
            f"found joints of shape {joints.shape}, expected (frames, 22, 3) with {MIN_FRAMES} "
            "frames or more, HumanML3D's skeleton at 20 frames per second"
        )
    if not np.isfinite(joints).all():
        raise InputError("joints are not all numbers (NaN or infinite); repair the motion first")
    joints = joints - np.array([0, _floor(joints), 0])
    heading = _heading(joints)
    trunk = joints[:, JOINT["neck"]] - joints[:, 0]
    trunk = trunk / (np.linalg.norm(trunk, axis=1, keepdims=True) + 1e-9)
    ahead = np.stack([np.sin(heading), np.cos(heading)], axis=1)
    forward = (trunk[:, ::2] * ahead).sum(axis=1)
    return Signals(
        joints=joints,
        local=_local(joints, heading),
        heading=heading,
        velocity=_velocity(joints, heading),
        tilt=np.degrees(np.arccos(np.clip(trunk[:, 1], -1, 1))),
        lean=np.degrees(np.arctan2(forward, trunk[:, 1])),
        feet=_foot_heights(joints),
    )


def spans(values: Bool[np.ndarray, " frames"], shortest: int = 1) -> Iterator[tuple[int, int]]:
    """Yields first frame and one past the last of every stretch that is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values.astype(np.int8), [0]])))
    for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if end - start >= shortest:
            yield start, end


def closed_gaps(values: Bool[np.ndarray, " frames"], longest: int) -> Bool[np.ndarray, " frames"]:
    """Fills stretches of false between true ones that are not longer than `longest`."""
    filled = values.copy()
    for start, end in spans(~values):
        if start > 0 and end < len(values) and end - start <= longest:
            filled[start:end] = True
    return filled


def peaks(curve: Float[np.ndarray, " frames"], least: float, drop: float) -> list[int]:
    """Returns where a curve has maxima of at least `least` that stand out by `drop` on both sides.

    The first and last frame count as a fall to zero only if the curve falls there.
    """
    found: list[int] = []
    low, top = curve[0], -1
    for frame, value in enumerate(curve.tolist()):
        if top < 0:
            low = min(low, value)
            if value >= least and value - low >= drop:
                top = frame
        elif value > curve[top]:
            top = frame
        elif curve[top] - value >= drop:
            found.append(top)
            low, top = value, -1
    return [*found, top] if top >= 0 and top < len(curve) - 1 else found


def smooth(curve: Float[np.ndarray, "*all"], sigma: float) -> Float[np.ndarray, "*all"]:
    """Smooths along the first axis; `sigma` in frames."""
    flat = gaussian_smooth(curve.reshape(len(curve), -1), sigma)
    return flat.reshape(curve.shape)


def bend(signals: Signals, first: str, middle: str, last: str) -> Float[np.ndarray, " frames"]:
    """Returns the angle at the middle of three joints, degrees; 180 is stretched."""
    one, two, three = (signals.joints[:, JOINT[name]] for name in (first, middle, last))
    a, b = one - two, three - two
    length = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) + 1e-9
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1) / length, -1, 1)))


def twist_of(signals: Signals) -> tuple[float, float]:
    """Returns how far the shoulders turn to the left and right of the hips, degrees."""
    across = signals.of("right_shoulder") - signals.of("left_shoulder")
    angle = smooth(np.degrees(np.arctan2(across[:, 2], -across[:, 0])), 2.0)
    return float(max(angle.max(), 0)), float(max(-angle.min(), 0))


def activity_of(signals: Signals) -> float:
    """Returns the mean speed of hands, feet and head, m/s."""
    ends = signals.joints[:, [10, 11, 15, 20, 21]]
    return float(np.linalg.norm(np.gradient(ends, axis=0), axis=-1).mean() * FPS)


def _floor(joints: Float[np.ndarray, "frames 22 3"]) -> float:
    """Zero is taken for the floor, up to what a badly placed body is off by."""
    lowest = float(np.percentile(joints[:, [7, 8, 10, 11], 1].min(axis=1), 5))
    return float(np.clip(lowest, -0.05, 0.05)) if abs(lowest) < 0.3 else float(joints[..., 1].min())


def _heading(joints: Float[np.ndarray, "frames 22 3"]) -> Float[np.ndarray, " frames"]:
    """From the hips, whose line tells little where it is steep; there it is interpolated."""
    across = joints[:, JOINT["right_hip"]] - joints[:, JOINT["left_hip"]]
    flat = np.hypot(across[:, 0], across[:, 2])
    sure = flat > 0.7 * np.linalg.norm(across, axis=1)
    heading = np.arctan2(across[:, 2], -across[:, 0])
    if not sure.any():
        return np.unwrap(heading)
    known = np.flatnonzero(sure)
    heading = np.interp(np.arange(len(joints)), known, np.unwrap(heading[known]))
    return smooth(heading, 2.0)


def _local(
    joints: Float[np.ndarray, "frames 22 3"], heading: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames 22 3"]:
    away = joints - joints[:, :1] * np.array([1, 0, 1])
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    x, z = away[..., 0], away[..., 2]
    return np.stack([c * x - s * z, away[..., 1], s * x + c * z], axis=-1)


def _velocity(
    joints: Float[np.ndarray, "frames 22 3"], heading: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames 2"]:
    way = smooth(joints[:, 0, ::2], 1.0)
    step = smooth(np.gradient(way, axis=0) * FPS, 4.0)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1]], axis=1)


def _foot_heights(joints: Float[np.ndarray, "frames 22 3"]) -> Float[np.ndarray, "frames 2"]:
    ankle, toe = joints[:, [7, 8], 1] - 0.06, joints[:, [10, 11], 1] - 0.01
    return np.maximum(np.minimum(ankle, toe), 0)
