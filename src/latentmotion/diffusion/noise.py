"""Noise with a seed per motion, drawn on the CPU: the same motion on every device, in any batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


class SeededNoise:
    """Standard normal numbers; each row of the batch comes from a generator of its own."""

    def __init__(self, seeds: Sequence[int]) -> None:
        self._generators = [np.random.default_rng(seed) for seed in seeds]

    def __call__(self, shape: tuple[int, ...]) -> Float[np.ndarray, "batch tokens width"]:
        """Returns the next numbers of every row; `shape` is (batch, tokens, width)."""
        rows = [g.standard_normal(shape[1:], dtype=np.float32) for g in self._generators]
        return np.stack(rows)
