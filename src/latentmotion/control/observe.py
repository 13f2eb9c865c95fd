"""Observation: keypoints beside the joints of a motion; how far off they are, with derivatives.

    joints of the motion → turned by yaw, tilted by pitch, shifted → in time between two frames
    → keypoints, weighted sums of joints → a camera's picture, if they are flat → Huber's loss

A camera is at the origin and looks along +z, y up; so its right is -x. What is off in its picture
counts in meters at the person's distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from latentmotion.representation.canonical import turn

# Deviations beyond which what is off counts by its size, no longer by its square.
_HUBER = 3.0

# Meters from the camera at which points nearer to it are taken to be.
_NEAREST = 0.3


@dataclass(frozen=True, eq=False)
class Observation:
    """Keypoints of one person in some frames of a motion."""

    points: Float[np.ndarray, "observed keypoints coordinates"]
    """Meters; or what a camera of focal length 1 sees, right and down. 0 where not seen."""
    weights: Float[np.ndarray, "observed keypoints"]
    """Weight of each; 0 where it was not seen."""
    positions: Float[np.ndarray, " observed"]
    """When each was observed, in frames of the motion."""
    joints: Float[np.ndarray, "keypoints joints"]
    """Each keypoint as a weighted sum of joints."""
    frames: int
    """Length of the motion."""
    depth: Float[np.ndarray, " observed"] | None = None
    """Meters from the camera, roughly, where the points are flat."""

    @cached_property
    def times(self) -> Float[np.ndarray, "observed frames"]:
        """Shares of the two frames between which each was observed."""
        before = np.clip(self.positions.astype(int), 0, max(self.frames - 2, 0))
        share, rows = np.clip(self.positions - before, 0, 1), np.arange(len(before))
        shares = np.zeros((len(before), self.frames))
        shares[rows, before] = 1 - share
        shares[rows, np.minimum(before + 1, self.frames - 1)] += share
        return shares

    def missing(
        self, placed: Float[np.ndarray, "frames joints 3"]
    ) -> Float[np.ndarray, "observed keypoints coordinates"]:
        """Returns seen minus expected, meters, for joints where the tracker sees them."""
        expected = self._keypoints(placed)
        if self.depth is not None:
            expected = expected[..., :2] / -np.maximum(expected[..., 2:], _NEAREST)
            return (self.points - expected) * self.depth[:, None, None]
        return self.points - expected

    def loss(
        self,
        joints: Float[np.ndarray, "frames joints 3"],
        placement: Float[np.ndarray, " 5"],
        noise: float,
    ) -> tuple[float, Float[np.ndarray, "frames joints 3"], Float[np.ndarray, " 5"]]:
        """Returns Huber's loss, and its derivatives by joints and placement.

        Args:
            joints: A motion as it is decoded.
            placement: Its yaw, x, y, z and pitch.
            noise: Deviation of what was observed, meters.
        """
        yaw, *_, pitch = placement
        turned = turn(joints, np.array(yaw))
        tilted = tilt(turned, pitch)
        placed = tilted + placement[1:4]
        off = self.missing(placed) / noise
        far = np.linalg.norm(off, axis=-1)
        value = np.where(far < _HUBER, 0.5 * far**2, _HUBER * (far - 0.5 * _HUBER))
        gradient = -(self.weights * robust(far))[..., None] * off / noise
        if self.depth is not None:
            gradient = self._through_camera(gradient, self._keypoints(placed))
        pull = np.einsum("okc,kj->ojc", gradient, self.joints)
        pull = np.tensordot(self.times, pull, (0, 0))
        around = tilted[..., 1] * pull[..., 2] - tilted[..., 2] * pull[..., 1]
        back = tilt(pull, -pitch)
        about = back[..., 0] * turned[..., 2] - back[..., 2] * turned[..., 0]
        of_placement = np.array([about.sum(), *pull.sum((0, 1)), around.sum()])
        if self.depth is None:
            of_placement[4] = 0
        return float((self.weights * value).sum()), turn(back, np.array(-yaw)), of_placement

    def _keypoints(
        self, placed: Float[np.ndarray, "frames joints 3"]
    ) -> Float[np.ndarray, "observed keypoints 3"]:
        return np.einsum("kj,ojc->okc", self.joints, np.tensordot(self.times, placed, 1))

    def _through_camera(
        self,
        gradient: Float[np.ndarray, "observed keypoints 2"],
        points: Float[np.ndarray, "observed keypoints 3"],
    ) -> Float[np.ndarray, "observed keypoints 3"]:
        assert self.depth is not None
        z = np.maximum(points[..., 2:], _NEAREST)
        flat = -gradient * self.depth[:, None, None] / z
        ahead = -(flat * points[..., :2]).sum(axis=-1, keepdims=True) / z
        return np.concatenate([flat, np.where(points[..., 2:] > _NEAREST, ahead, 0)], axis=-1)


def robust(far: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Returns Huber's weights of distances, which are in deviations."""
    return _HUBER / np.maximum(far, _HUBER)


def tilt(points: Float[np.ndarray, "*batch 3"], pitch: float) -> Float[np.ndarray, "*batch 3"]:
    """Rotates points about x; a positive angle, radians, moves +y toward +z."""
    c, s = np.cos(pitch), np.sin(pitch)
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    return np.stack([x, c * y - s * z, s * y + c * z], axis=-1)
