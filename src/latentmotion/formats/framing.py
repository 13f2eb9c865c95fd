"""Where a camera stands that sees a motion well: half from the front, or across its path."""

from __future__ import annotations

import numpy as np

from latentmotion.motion import Motion
from latentmotion.render import painter
from latentmotion.render.camera import Camera, camera_around

_SHORT = 0.8
"""Meters of path below which a motion counts as on the spot."""


def camera_of_all(
    motion: Motion, bodies: painter.Bodies, size: tuple[int, int]
) -> tuple[Camera, float]:
    """Looks across the path, from as far as it takes to see all figures.

    Args:
        motion: Whose path it is.
        bodies: What must be seen.
        size: Width and height of the picture, pixels.

    Returns:
        The camera, and the meters that fill the picture's height.
    """
    center = (bodies.vertices.min((0, 1)) + bodies.vertices.max((0, 1))) / 2
    azimuth, height = _across(motion), 2.2
    camera = camera_around(center, azimuth, np.radians(16), 9, size, height)
    for _ in range(12):
        pixels, _ = camera.project(bodies.vertices)
        height *= float(np.abs(pixels / np.array(size) - 0.5).max()) / 0.46
        camera = camera_around(center, azimuth, np.radians(16), max(9, 2 * height), size, height)
    return camera, height


def half_front(motion: Motion) -> float:
    """Returns the azimuth from which the person is seen half from the front at the start."""
    return painter.facing(motion.joints, motion.skeleton.names) - np.radians(38)


def _across(motion: Motion) -> float:
    """Returns the side from which the path is seen at length and the person not from behind."""
    spread = motion.joints[:, 0][:, [0, 2]].astype(np.float64)
    spread = spread - spread.mean(0)
    front = half_front(motion)
    if np.linalg.norm(np.ptp(spread, axis=0)) < _SHORT:
        return front
    x, z = np.linalg.svd(spread, full_matrices=False)[2][0]
    side = float(np.arctan2(z, -x))
    return side if np.cos(side - front) > 0 else side + np.pi
