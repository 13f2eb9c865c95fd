"""Root motion: a figure that walks, or one that walks in place, as game engines move it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.cleanup.smoothing import gaussian


def ground_path(
    joints: Float[np.ndarray, "frames joints 3"], fps: float, seconds: float = 0.25
) -> Float[np.ndarray, "frames 3"]:
    """Returns the path of the root along the floor, without the sway of its steps.

    Args:
        joints: Positions, meters, y up; joint 0 is the root.
        fps: Frames per second.
        seconds: Deviation of the Gaussian that takes out the sway; 0 keeps it.
    """
    return gaussian(joints[:, 0] * (1, 0, 1), seconds * fps)


def in_place(
    joints: Float[np.ndarray, "frames joints 3"], fps: float, seconds: float = 0.25
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns the joints with the path taken away: the figure stays above the origin."""
    return joints - ground_path(joints, fps, seconds)[:, None]
