"""The towers of a scorer as a text-motion evaluator: FID, R-precision and MM-Dist of unit vectors.

A scorer that chose among a model's takes, or that a model was trained by, is no judge of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.data.clip import Caption
from latentmotion.ranking.scorer import Scorer


@dataclass(frozen=True)
class ScorerEvaluator:
    """A scorer behind the interface of evaluators."""

    scorer: Scorer
    """The towers."""

    @property
    def width(self) -> int:
        """Numbers per vector."""
        return self.scorer.card.width

    @property
    def fingerprint(self) -> str:
        """Hash of weights and statistics."""
        return self.scorer.card.fingerprint

    def motions(
        self, features: Sequence[Float[np.ndarray, "_ features"]]
    ) -> Float[np.ndarray, "items width"]:
        """Returns the vectors of motions, given in their own units."""
        return self.scorer.embed(features)

    def texts(self, captions: Sequence[Caption]) -> Float[np.ndarray, "items width"]:
        """Returns the vectors of captions."""
        return self.scorer.texts([caption.text for caption in captions])


def load_scorer(folder: Path) -> ScorerEvaluator:
    """Reads a scorer's folder.

    Raises:
        ModelError: A file is missing or damaged, or no model has its text encoder.
    """
    return ScorerEvaluator(Scorer.load(folder))
