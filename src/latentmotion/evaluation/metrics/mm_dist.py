"""MM-Dist: the mean distance between a caption's vector and that of the motion made from it.

    mean over items of |text − motion|

Guo et al. 2022, section 6.1 (their code calls it matching score).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def mm_dist(
    texts: Float[np.ndarray, "items width"], motions: Float[np.ndarray, "items width"]
) -> float:
    """Returns the mean distance of the pairs, row by row."""
    apart = np.asarray(texts, np.float64) - np.asarray(motions, np.float64)
    return float(np.linalg.norm(apart, axis=1).mean())
