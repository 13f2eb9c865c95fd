"""A pinhole camera: points in the world → pixels; and cameras that see a motion well.

pixel = middle + focal · (right·p, −up·p) / (ahead·p),   p relative to the eye
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.motion import Motion

_SHORT = 0.8
"""Meters of path below which a motion counts as in place."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole that looks at a point."""

    eye: Float[np.ndarray, " width"]
    """Its position, meters."""
    target: Float[np.ndarray, " width"]
    """The point it looks at, in the middle of the picture, meters."""
    focal: float
    """Pixels for one meter at one meter's distance."""
    size: tuple[int, int]
    """Width and height of the picture, pixels."""

    def project(
        self, points: Float[np.ndarray, "*batch 3"]
    ) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch"]]:
        """Returns pixels (right, down) and distances along the line of sight."""
        right, up, ahead = self.axes()
        relative = points - self.eye
        depth = relative @ ahead
        scale = self.focal / np.maximum(depth, 0.1)
        middle = np.array(self.size) / 2
        flat = np.stack([relative @ right, -(relative @ up)], axis=-1)
        return middle + flat * scale[..., None], depth

    def axes(self) -> tuple[Float[np.ndarray, " width"], ...]:
        """Returns the unit vectors to the right, up and ahead."""
        ahead = unit(self.target - self.eye)
        right = unit(np.cross(ahead, np.array([0.0, 1.0, 0.0])))
        return right, np.cross(right, ahead), ahead


def camera_around(
    target: Float[np.ndarray, " width"],
    azimuth: float,
    elevation: float,
    distance: float,
    size: tuple[int, int],
    visible_height: float,
) -> Camera:
    """Places a camera on a sphere around a point.

    Args:
        target: Center of the sphere, meters.
        azimuth: Angle of the camera about the vertical, from +z towards +x, radians.
        elevation: Angle above the horizontal, radians.
        distance: Radius, meters; a large one looks almost without perspective.
        size: Width and height of the picture, pixels.
        visible_height: Meters at the target that fill the picture's height.
    """
    level = np.cos(elevation)
    toward = np.array([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level])
    return Camera(target + distance * toward, target, size[1] * distance / visible_height, size)


def camera_of_all(
    motion: Motion, vertices: Float[np.ndarray, "frames vertices 3"], size: tuple[int, int]
) -> tuple[Camera, float]:
    """Returns a camera that looks across the path, not from behind, and sees all figures.

    Args:
        motion: The motion, for its path.
        vertices: The points that must be seen, meters.
        size: Width and height of the picture, pixels.

    Returns:
        The camera, and the meters that fill the picture's height.
    """
    center = (vertices.min((0, 1)) + vertices.max((0, 1))) / 2
    azimuth, height = half_front(motion), 2.2
    path = motion.joints[:, 0][:, [0, 2]].astype(np.float64)
    path = path - path.mean(0)
    if np.linalg.norm(np.ptp(path, axis=0)) >= _SHORT:
        x, z = np.linalg.svd(path, full_matrices=False)[2][0]
        side = float(np.arctan2(z, -x))
        azimuth = side if np.cos(side - azimuth) > 0 else side + np.pi
    camera = camera_around(center, azimuth, np.radians(16), 9, size, height)
    for _ in range(12):
        pixels, _ = camera.project(vertices)
        height *= float(np.abs(pixels / np.array(size) - 0.5).max()) / 0.46
        camera = camera_around(center, azimuth, np.radians(16), max(9, 2 * height), size, height)
    return camera, height


def half_front(motion: Motion) -> float:
    """Returns the azimuth that shows the person half from the front at the start."""
    return facing(motion.joints, motion.skeleton.names) - np.radians(38)


def facing(joints: Float[np.ndarray, "frames joints 3"], names: Sequence[str]) -> float:
    """Returns the heading of the first frame: the angle about the vertical from +z to +x."""
    across = joints[0, names.index("left_hip")] - joints[0, names.index("right_hip")]
    return float(np.arctan2(-across[2], across[0]))
