"""A camera: points in the world → pixels, by a pinhole.

pixel = middle + focal · (right·p, −up·p) / (ahead·p),   p relative to the eye
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole that looks at a point."""

    eye: Float[np.ndarray, " width"]
    """Where it stands, meters."""
    target: Float[np.ndarray, " width"]
    """What it looks at: the middle of the picture, meters."""
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


def unit(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Returns vectors of length 1 in the same directions."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
