"""Noise with a seed per motion, drawn on the CPU: the same motion on every device, in any batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


class SeededNoise:
    """Standard normal numbers; each row of the batch comes from a generator of its own.

    Args:
        seeds: One per row.
        tokens: How many tokens each row has; the rest of it is zero. By default all are real.
            So a row gets the same numbers whatever it is padded to.
    """

    def __init__(self, seeds: Sequence[int], tokens: Sequence[int] | None = None) -> None:
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._tokens = tokens

    def __call__(self, shape: tuple[int, ...]) -> Float[np.ndarray, "batch tokens width"]:
        """Returns the next numbers of every row; `shape` is (batch, tokens, width)."""
        noise = np.zeros(shape, np.float32)
        tokens = [shape[1]] * shape[0] if self._tokens is None else self._tokens
        for row, generator, count in zip(noise, self._generators, tokens, strict=True):
            row[:count] = generator.standard_normal((count, *shape[2:]), dtype=np.float32)
        return noise
