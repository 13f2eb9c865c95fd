"""ACCL: the error of the joints' acceleration.

    mean over frames t and joints of |(p_t − 2 p_{t+1} + p_{t+2}) − (q_t − 2 q_{t+1} + q_{t+2})|

in millimeters per squared frame, so that data of different frame rates do not compare. Kanazawa
et al. 2019, "Learning 3D human dynamics from video", section 5; MLD, section 4.1.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def acceleration_errors(
    predicted: Float[np.ndarray, "frames joints 3"], true: Float[np.ndarray, "frames joints 3"]
) -> Float[np.ndarray, " inner"]:
    """Returns the mean joint error of each frame but two, in the unit of the joints."""
    apart = np.asarray(predicted, np.float64) - np.asarray(true, np.float64)
    return np.linalg.norm(np.diff(apart, n=2, axis=0), axis=-1).mean(axis=-1)


def accl(
    predicted: Float[np.ndarray, "frames joints 3"], true: Float[np.ndarray, "frames joints 3"]
) -> float:
    """Returns the mean error in mm/frame², for joints in meters; 0 for fewer than three frames."""
    errors = acceleration_errors(predicted, true)
    return 1000 * float(errors.mean()) if len(errors) else 0.0
