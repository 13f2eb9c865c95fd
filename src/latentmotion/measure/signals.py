"""Curves over time that all measurements share: heading, speed, heights, the body frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.arrays import dot, length, quantile
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import HUMANML3D, Joints
from latentmotion.measure.facts import FPS, LEFT, RIGHT
from latentmotion.representation.canonical import gaussian_smooth

Curve = Float[np.ndarray, " frames"]  # A number for each frame.

JOINT = {name: index for index, name in enumerate(HUMANML3D.names)}  # Index of each joint by name.

STANDING = 0.92  # Meters from the floor to the pelvis of HumanML3D's body when it stands.

MIN_FRAMES = 4


@dataclass(frozen=True, eq=False)
class Signals:
    """Curves of one motion, 20 frames per second, meters, radians; the floor is at zero."""

    joints: Float[np.ndarray, "frames 22 3"]  # Joint positions above the floor.
    # Joints in the body frame: x to the left, y above the floor, z ahead of the pelvis.
    local: Float[np.ndarray, "frames 22 3"]
    # Direction that the hips face, without jumps of a full turn; left is positive.
    heading: Curve
    # Velocity of the pelvis to its left and ahead, m/s, without the sway of single steps.
    velocity: Float[np.ndarray, "frames 2"]
    tilt: Curve  # Degrees of the trunk away from upright.
    # Degrees by which the trunk leans forward; negative is backward.
    lean: Curve
    # Height of the lowest joint of the left and right foot above where it stands.
    feet: Float[np.ndarray, "frames 2"]

    @property
    def frames(self) -> int:
        """Length of the motion."""
        return len(self.joints)

    @cached_property
    def speed(self) -> Curve:
        """Speed of the pelvis over the floor, m/s."""
        return length(self.velocity)

    def of(self, name: str) -> Float[np.ndarray, "frames 3"]:
        """Returns the position of a joint in the body frame."""
        return self.local[:, JOINT[name]]


def measure(joints: Joints) -> Signals:
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
    lowest = float(quantile(joints[:, [7, 8, 10, 11], 1].min(axis=1), 0.05))
    if abs(lowest) < 0.3:  # zero is the floor, up to the error of a badly placed body
        floor = float(np.clip(lowest, -0.05, 0.05))
    else:
        floor = float(joints[..., 1].min())
    joints = joints - np.array([0, floor, 0])
    # Heading of the line between the hips; where that line is steep, it is interpolated.
    across = joints[:, JOINT["right_hip"]] - joints[:, JOINT["left_hip"]]
    level = np.hypot(across[:, 0], across[:, 2]) > 0.7 * length(across)
    heading = np.arctan2(across[:, 2], -across[:, 0])
    if level.any():
        upright = np.flatnonzero(level)
        heading = np.interp(np.arange(len(joints)), upright, np.unwrap(heading[upright]))
        heading = smooth(heading, 2.0)
    else:
        heading = np.unwrap(heading)
    c, s = np.cos(heading), np.sin(heading)
    x, y, z = np.moveaxis(joints - joints[:, :1] * np.array([1, 0, 1]), -1, 0)
    trunk = joints[:, JOINT["neck"]] - joints[:, 0]
    trunk = trunk / (length(trunk)[:, None] + 1e-9)
    forward = trunk[:, 0] * s + trunk[:, 2] * c
    step = smooth(np.gradient(smooth(joints[:, 0, ::2], 1.0), axis=0) * FPS, 4.0)
    ankle, toe = joints[:, [7, 8], 1] - 0.06, joints[:, [10, 11], 1] - 0.01
    return Signals(
        joints=joints,
        local=np.stack([c[:, None] * x - s[:, None] * z, y, s[:, None] * x + c[:, None] * z], -1),
        heading=heading,
        velocity=np.stack(
            [c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1]], axis=1
        ),
        tilt=np.degrees(np.arccos(np.clip(trunk[:, 1], -1, 1))),
        lean=np.degrees(np.arctan2(forward, trunk[:, 1])),
        feet=np.maximum(np.minimum(ankle, toe), 0),
    )


def spans(values: Bool[np.ndarray, " frames"], shortest: int = 1) -> Iterator[tuple[int, int]]:
    """Yields the first frame and one past the last of every interval in which `values` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values.astype(np.int8), [0]])))
    for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if end - start >= shortest:
            yield start, end


def closed_gaps(values: Bool[np.ndarray, " frames"], longest: int) -> Bool[np.ndarray, " frames"]:
    """Fills gaps between true intervals that are not longer than `longest` frames."""
    filled = values.copy()
    for start, end in spans(~values):
        if start > 0 and end < len(values) and end - start <= longest:
            filled[start:end] = True
    return filled


def peaks(curve: Curve, least: float, drop: float) -> list[int]:
    """Returns the frames of maxima of at least `least` that stand out by `drop` on both sides.

    The first and last frame count as a fall to zero only if the curve falls there.
    """
    tops: list[int] = []
    low, top = curve[0], -1
    for frame, value in enumerate(curve.tolist()):
        if top < 0:
            low = min(low, value)
            if value >= least and value - low >= drop:
                top = frame
        elif value > curve[top]:
            top = frame
        elif curve[top] - value >= drop:
            tops.append(top)
            low, top = value, -1
    return [*tops, top] if top >= 0 and top < len(curve) - 1 else tops


def intervals(codes: Int[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    """Returns the first frame and one past the last of every run of equal codes."""
    edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(codes)]
    return list(pairwise(edges))


def without_short_intervals(
    codes: Int[np.ndarray, " frames"], shortest: int, weak: int | None = None
) -> Int[np.ndarray, " frames"]:
    """Replaces codes of runs that are too short, the shortest first, by the code before them.

    Args:
        codes: A code per frame.
        shortest: Frames of the shortest run that is kept.
        weak: A code that is not spread if another one follows the run.
    """
    codes = codes.copy()
    while True:
        runs = intervals(codes)
        start, end = min(runs, key=lambda run: run[1] - run[0])
        if end - start >= shortest or len(runs) == 1:
            return codes
        before = codes[start - 1] if start else codes[end]
        after = codes[end] if end < len(codes) else before
        codes[start:end] = after if before == weak else before


def monotone_intervals(curve: Curve, least: float) -> list[tuple[int, int]]:
    """Returns the first and last frame of rises and falls; turns back by `least` separate them."""
    values = curve.tolist()
    low = high = 0
    sense, runs, last = 0, [], 0
    for frame, value in enumerate(values):
        if value < values[low]:
            low = frame
        if value > values[high]:
            high = frame
        if sense >= 0 and values[high] - value > least:
            if sense > 0:
                runs.append((last, high))
            sense, last, low = -1, high, frame
            high = frame
        elif sense <= 0 and value - values[low] > least:
            if sense < 0:
                runs.append((last, low))
            sense, last, high = 1, low, frame
            low = frame
    if sense:
        runs.append((last, high if sense > 0 else low))
    return [run for run in runs if run[1] - run[0] > 2]


def bearing(left: float, ahead: float) -> str:
    """Returns `forward`, `backward`, `left` or `right` for a vector in the body frame."""
    angle = np.degrees(np.arctan2(left, ahead))
    if abs(angle) < 50:
        return "forward"
    return "backward" if abs(angle) > 130 else LEFT if angle > 0 else RIGHT


def around_peak(curve: Curve, top: int, level: float) -> tuple[int, int]:
    """Returns the last frame before a peak, or -1, and the first after it that is below `level`."""
    low = curve < level
    before, after = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    return int(before[-1]) if len(before) else -1, top + int(after[0]) if len(after) else len(curve)


def valley(curve: Curve, top: int) -> tuple[int, int]:
    """Returns where a curve leaves and comes back to a third of a peak, or turns up again."""
    before, end = around_peak(curve, top, 0.35 * curve[top])
    start = max(before, 0)
    higher = np.flatnonzero(curve > 1.001 * curve[top])
    left, right = higher[higher < top], higher[higher > top]
    if len(left) and left[-1] >= start:
        start = int(left[-1] + np.argmin(curve[left[-1] : top + 1]))
    if len(right) and right[0] < end:
        end = int(top + np.argmin(curve[top : right[0] + 1]))
    return start, end


def smooth(curve: Float[np.ndarray, "*all"], sigma: float) -> Float[np.ndarray, "*all"]:
    """Smooths along the first axis; `sigma` in frames."""
    flat = gaussian_smooth(curve.reshape(len(curve), -1), sigma)
    return flat.reshape(curve.shape)


def bend(signals: Signals, first: str, middle: str, last: str) -> Curve:
    """Returns the angle at the middle of three joints, degrees; 180 is stretched."""
    start, two, three = (signals.joints[:, JOINT[name]] for name in (first, middle, last))
    a, b = start - two, three - two
    return np.degrees(np.arccos(np.clip(dot(a, b) / (length(a) * length(b) + 1e-9), -1, 1)))


def twist_of(signals: Signals) -> tuple[float, float]:
    """Returns how far the shoulders turn to the left and right of the hips, degrees."""
    across = signals.of("right_shoulder") - signals.of("left_shoulder")
    angle = smooth(np.degrees(np.arctan2(across[:, 2], -across[:, 0])), 2.0)
    return float(max(angle.max(), 0)), float(max(-angle.min(), 0))


def activity_of(signals: Signals) -> float:
    """Returns the mean speed of hands, feet and head, m/s."""
    ends = signals.joints[:, [10, 11, 15, 20, 21]]
    return float(length(np.gradient(ends, axis=0)).mean() * FPS)
