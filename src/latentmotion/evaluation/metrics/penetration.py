"""Floor penetration: how deep the lowest joint is below the floor.

    mean over frames t of   max(0, floor − min_j y_jt),   meters

Yuan et al. 2023, "PhysDiff", section 4, with joints in place of a body mesh.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def penetration(joints: Float[np.ndarray, "frames joints 3"], floor: float = 0.0) -> float:
    """Returns the mean depth of the lowest joint below the floor, meters.

    Args:
        joints: Joint positions, meters, y up.
        floor: Height of the floor, meters.
    """
    lowest = np.asarray(joints, dtype=np.float64)[..., 1].min(axis=1)
    return float(np.maximum(0, floor - lowest).mean())
