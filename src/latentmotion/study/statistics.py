"""Statistics of wins and losses, in closed form.

Wilson's interval (1927) of a proportion p = k/n at z = 1.96:

    (p + z²/2n ± z √(p(1 − p)/n + z²/4n²)) / (1 + z²/n)

The exact sign test: under "no preference" wins are binomial(n, 1/2), so both tails have
min(1, 2 Σ_{i ≥ max(k, n−k)} C(n, i) / 2ⁿ).

Krippendorff's α = 1 − D_observed / D_expected, for labels: 1 is full agreement, 0 that of chance.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence

Z = 1.959963984540054
"""Normal quantile of a 95 % interval."""


def wilson(wins: int, n: int, z: float = Z) -> tuple[float, float]:
    """Returns the 95 % confidence interval of a proportion; (0, 1) where nothing is known."""
    if n == 0:
        return 0.0, 1.0
    p, scale = wins / n, 1 + z * z / n
    middle = p + z * z / (2 * n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)


def sign_test(wins: int, n: int) -> float:
    """Returns the two-sided exact p-value of "no preference"."""
    tail = sum(math.comb(n, i) for i in range(max(wins, n - wins), n + 1))
    return min(1.0, 2 * tail / 2**n)


def observed_agreement(ratings: Iterable[Sequence[Hashable]]) -> float | None:
    """Returns the share of pairs of ratings of one item that agree; None if there is no pair.

    Args:
        ratings: For each item the ratings of its raters.
    """
    agreeing = possible = 0
    for item in ratings:
        agreeing += sum(math.comb(count, 2) for count in Counter(item).values())
        possible += math.comb(len(item), 2)
    return agreeing / possible if possible else None


def krippendorff(ratings: Iterable[Sequence[Hashable]]) -> float | None:
    """Returns α for labels, without items that have a single rating; None if undefined."""
    items = [Counter(item) for item in ratings if len(item) > 1]
    total = sum(sum(item.values()) for item in items)
    disagreeing = sum(_unlike(item) / (sum(item.values()) - 1) for item in items)
    expected = _unlike(sum(items, Counter())) / (total - 1) if total > 1 else 0.0
    return 1 - disagreeing / expected if expected else None


def _unlike(counts: Counter[Hashable]) -> int:
    """Counts ordered pairs of unlike labels."""
    total = sum(counts.values())
    return total * total - sum(count * count for count in counts.values())
