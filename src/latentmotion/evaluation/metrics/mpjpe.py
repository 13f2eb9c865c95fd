"""MPJPE: how far reconstructed joints are from the true ones.

mean over frames and joints of |p - q|, after the root of each frame is moved to the origin (as the
MLD authors' code has it; the paper says "global"), or, with `align=False`, in the world.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace


def mpjpe(
    predicted: Float[Any, "*batch frames joints 3"],
    true: Float[Any, "*batch frames joints 3"],
    align: bool = True,
) -> float:
    """Returns the mean per-joint position error in millimeters.

    Args:
        predicted: Joint positions, meters.
        true: The positions they should have, meters.
        align: Whether each frame's root is moved to the origin first.
    """
    xp = array_namespace(predicted, true)
    if align:
        predicted, true = predicted - predicted[..., :1, :], true - true[..., :1, :]
    return 1000 * float(xp.mean(xp.sqrt(xp.sum((predicted - true) ** 2, axis=-1))))


def joint_errors(
    predicted: Float[np.ndarray, "frames joints 3"], true: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, " frames"]:
    """Returns the mean error of each frame after the root is moved to the origin, in its unit."""
    apart = (predicted - predicted[:, :1]) - (true - true[:, :1])
    return np.linalg.norm(apart, axis=-1).mean(axis=-1)
