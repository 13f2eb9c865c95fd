"""Accuracy: the share of motions whose label a classifier recognizes.

Guo et al. 2020, "Action2Motion", section 5.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int


def accuracy(logits: Float[np.ndarray, "items labels"], labels: Int[np.ndarray, " items"]) -> float:
    """Returns the share of rows whose greatest logit is at their label."""
    return float((logits.argmax(axis=1) == labels).mean())
