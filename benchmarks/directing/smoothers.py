"""Smoothers beside which fits stand: splines and a Kalman smoother, each joint by itself.

Both are told the deviation of the noise, which fits are not.

    spline   natural cubic, as little bent as leaves the noise it is told     (Reinsch 1967)
    Kalman   constant acceleration, which white noise changes: forward filter, backward smoother
             (Rauch, Tung & Striebel 1965); how much it changes is what makes the seen likeliest
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import make_smoothing_spline

Joints = Float[np.ndarray, "frames joints 3"]
Seen = Bool[np.ndarray, "frames joints"]

# Weight of bending beside distances, frames³, the stiffest first.
_STIFFNESSES = (1e5, 1e4, 1e3, 300.0, 100.0, 30.0, 10.0, 3.0, 1.0, 0.1)

# Deviations of what changes the acceleration in a second, m/s³ by √Hz, of which one is taken.
_CHANGES = (3.0, 10.0, 30.0, 100.0, 300.0)

# Deviations of place, speed and acceleration before anything is seen: m, m/s, m/s².
_AT_FIRST = (10.0, 3.0, 30.0)


def spline(joints: Joints, seen: Seen, noise: float) -> Joints:
    """Returns joints on smoothing splines through what was seen.

    Args:
        joints: What was seen; elsewhere anything.
        seen: Where each joint was; in five frames or more.
        noise: Deviation of each coordinate, meters.
    """
    found, frames = joints.copy(), np.arange(len(joints), dtype=float)
    for joint, own in enumerate(seen.T):
        for stiffness in _STIFFNESSES:
            curves = [
                make_smoothing_spline(frames[own], places, lam=stiffness)
                for places in joints[own, joint].T
            ]
            found[:, joint] = np.stack([curve(frames) for curve in curves], axis=1)
            if np.std(joints[own, joint] - found[own, joint]) < noise:
                break
    return found


def kalman(joints: Joints, seen: Seen, noise: float, fps: float) -> Joints:
    """Returns joints by the smoother whose strength makes what was seen likeliest.

    Args:
        joints: What was seen; elsewhere anything.
        seen: Where each joint was.
        noise: Deviation of each coordinate, meters.
        fps: Frames per second.
    """
    passes = [_Pass.forward(joints, seen, noise, fps, change) for change in _CHANGES]
    return max(passes, key=lambda one: one.likelihood).smoothed()


@dataclass(frozen=True, eq=False)
class _Pass:
    """The forward pass: states of place, speed and acceleration with what was seen until then."""

    step: Float[np.ndarray, "3 3"]  # One frame at constant acceleration.
    mean: list[Float[np.ndarray, "joints 3 axes"]]
    covariance: list[Float[np.ndarray, "joints 3 3"]]
    expected: list[Float[np.ndarray, "joints 3 axes"]]  # Means before each frame was seen.
    spread: list[Float[np.ndarray, "joints 3 3"]]  # Covariances before each frame was seen.
    likelihood: float  # Logarithm of the density of what was seen, up to a constant.

    @classmethod
    def forward(cls, joints: Joints, seen: Seen, noise: float, fps: float, change: float) -> _Pass:
        dt, count = 1 / fps, joints.shape[1]
        step = np.array([[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1]])
        rates = np.arange(3)
        powers = 5 - rates[:, None] - rates
        parts = np.array([2.0, 1.0, 1.0])  # factorials of 2, 1 and 0
        pushed = change**2 * dt**powers / (powers * parts[:, None] * parts)
        mean = np.zeros((count, 3, 3))
        mean[:, 0] = joints[seen.argmax(axis=0), np.arange(count)]
        covariance = np.broadcast_to(np.diag(np.square(_AT_FIRST)), (count, 3, 3)).copy()
        found = cls(step, [], [], [], [], 0.0)
        likelihood = 0.0
        for frame, (place, own) in enumerate(zip(joints, seen, strict=True)):
            if frame:
                mean, covariance = step @ mean, step @ covariance @ step.T + pushed
            found.expected.append(mean)
            found.spread.append(covariance)
            off, variance = place - mean[:, 0], covariance[:, 0, 0] + noise**2
            told = (off**2).sum(axis=1) / variance + 3 * np.log(variance)
            likelihood -= 0.5 * float(told[own].sum())
            gain = covariance[:, :, 0] / variance[:, None] * own[:, None]
            mean = mean + gain[:, :, None] * off[:, None]
            covariance = covariance - gain[:, :, None] * covariance[:, :1]
            found.mean.append(mean)
            found.covariance.append(covariance)
        return cls(step, found.mean, found.covariance, found.expected, found.spread, likelihood)

    def smoothed(self) -> Joints:
        """Returns places with what was seen later as well."""
        means = [self.mean[-1]]
        ahead = zip(self.expected, self.spread, strict=True)
        pairs = zip(zip(self.mean, self.covariance, strict=True), pairwise(ahead), strict=False)
        for (mean, covariance), (_, (expected, spread)) in reversed(list(pairs)):
            gain = np.linalg.solve(spread, self.step @ covariance).transpose(0, 2, 1)
            means.append(mean + gain @ (means[-1] - expected))
        return np.stack(means[::-1])[:, :, 0]
