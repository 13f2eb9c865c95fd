"""Shares with 95 % intervals where takes of one prompt resemble each other.

Wilson's score interval (Wilson 1927) for as many independent motions as the dependent ones are
worth (Kish 1965): n / (1 + (m - 1) ρ), with m takes a prompt and ρ the correlation of takes of one
prompt, estimated by analysis of variance, between 0 and 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from jaxtyping import Bool

Z = 1.959964
"""Of 95 %."""


@dataclass(frozen=True)
class Share:
    """How many motions of a group do what they are asked."""

    share: float
    """Part of all motions, 0 to 1."""
    low: float
    """Lower end of the 95 % interval."""
    high: float
    """Upper end of the 95 % interval."""
    motions: int
    """Number of motions."""
    prompts: int
    """Number of prompts, or of clips, that they belong to."""
    ever: float
    """Part of the prompts with at least one motion that does it."""

    @classmethod
    def of(cls, verdicts: Sequence[Sequence[bool]]) -> Share:
        """Summarizes verdicts, one row per prompt, at least one in all."""
        rows = [np.array(row, bool) for row in verdicts if len(row)]
        whole = np.concatenate(rows)
        low, high = wilson(float(whole.mean()), _worth(rows))
        ever = float(np.mean([row.any() for row in rows]))
        return cls(float(whole.mean()), low, high, len(whole), len(rows), ever)

    def __str__(self) -> str:
        return f"{100 * self.share:.0f} % ({100 * self.low:.0f}–{100 * self.high:.0f})"


def wilson(share: float, count: float) -> tuple[float, float]:
    """Returns Wilson's 95 % interval of a share of so many independent observations."""
    middle = (share + Z**2 / (2 * count)) / (1 + Z**2 / count)
    spread = share * (1 - share) / count + Z**2 / (4 * count**2)
    half = Z * sqrt(spread) / (1 + Z**2 / count)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def _worth(rows: list[Bool[np.ndarray, " takes"]]) -> float:
    """Returns how many independent motions these are worth: at least one a prompt."""
    sizes = np.array([len(row) for row in rows], float)
    count, groups = sizes.sum(), len(rows)
    if count == groups:
        return count
    usual = (count - (sizes**2).sum() / count) / max(groups - 1, 1)
    means = np.array([row.mean() for row in rows])
    grand = float((sizes * means).sum() / count)
    between = float((sizes * (means - grand) ** 2).sum()) / max(groups - 1, 1)
    within = float((sizes * means * (1 - means)).sum()) / (count - groups)
    spread = between + (usual - 1) * within
    # All alike, as of a single prompt: nothing tells how takes differ, so prompts count.
    rho = 1.0 if groups == 1 or spread <= 0 else float(np.clip((between - within) / spread, 0, 1))
    return count / (1 + (count / groups - 1) * rho)
