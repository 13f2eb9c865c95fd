"""What steers a motion: words, each a vector, and which of them are real."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from jaxtyping import Bool, Float


@dataclass(frozen=True)
class Conditioning:
    """The condition of a batch of motions, NumPy or torch."""

    tokens: Float[Any, "batch words width"]
    """One vector per word; a pooled sentence or a label is one word."""
    mask: Bool[Any, "batch words"]
    """True on real words."""
