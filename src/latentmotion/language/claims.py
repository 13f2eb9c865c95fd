"""Claims of a sentence: acts that it asks for or tells of, and what a prompt asks in all."""

from __future__ import annotations

from dataclasses import dataclass

LEFT, RIGHT, BOTH = "left", "right", "both"

SLIGHT = 25.0
"""Degrees of a turn that a sentence calls slight."""


@dataclass(frozen=True)
class Claim:
    """One act that a sentence mentions."""

    kind: str
    """As `Event.kind`, or `move` (any gait), `circle`, `stop`, `place` (on the spot)."""
    side: str = ""
    """Side of a hand, foot or knee, or of a turn."""
    direction: str = ""
    """`forward`, `backward`, `left`, `right`, `side` (either), `up`, `place`."""
    count: int = 0
    """Number of repetitions; zero where the sentence has none."""
    degrees: float = 0.0
    """Degrees of a turn; zero where the sentence has none."""
    pace: str = ""
    """`slow` or `fast`; empty where the sentence has none."""
    then: bool = False
    """Whether it comes after the claim before it."""


@dataclass(frozen=True)
class Request:
    """What a prompt asks for."""

    claims: tuple[Claim, ...]
    """The acts, in the order of the prompt."""
    in_turn: bool
    """Whether the acts follow one another; otherwise "while" or the like joins them."""
