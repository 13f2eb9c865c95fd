"""Nothing as a condition: no words at all, for models that learned motion alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from latentmotion.condition.interface import Conditioning


@dataclass(frozen=True)
class Unconditional:
    """Whatever is asked, the denoiser sees no condition."""

    width: int
    """Numbers per word that the denoiser expects."""

    def __call__(self, inputs: Sequence[object]) -> Conditioning:
        """Returns no words for each input."""
        return self.null(len(inputs))

    def null(self, count: int) -> Conditioning:
        """Returns no words, `count` times."""
        return Conditioning(
            np.zeros((count, 0, self.width), np.float32), np.zeros((count, 0), dtype=bool)
        )
