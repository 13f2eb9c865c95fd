"""Which places of a padded batch are real: masks are True on real frames, tokens and words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool


def mask_of(lengths: Sequence[int], most: int | None = None) -> Bool[np.ndarray, "batch longest"]:
    """Returns a row per length, True up to it; rows are as long as the longest, or `most`."""
    return np.arange(max(lengths) if most is None else most) < np.array(lengths)[:, None]
