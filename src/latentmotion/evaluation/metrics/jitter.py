"""Jitter: how much joints shake, as the mean size of their jerk.

    mean over joints j and frames t of   |p_{t+3} − 3 p_{t+2} + 3 p_{t+1} − p_t| · fps³,   m/s³

Flash and Hogan 1985 (minimum jerk); used so by Yi et al. 2021, "TransPose", section 5.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def jitter(joints: Float[np.ndarray, "frames joints 3"], fps: float) -> float:
    """Returns the mean jerk of the joints, m/s³; 0 for fewer than four frames.

    Args:
        joints: Joint positions, meters.
        fps: Frames per second.
    """
    jerk = np.diff(np.asarray(joints, dtype=np.float64), n=3, axis=0) * fps**3
    return float(np.linalg.norm(jerk, axis=-1).mean()) if len(jerk) else 0.0
