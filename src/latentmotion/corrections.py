"""Corrections: degrees and repetitions that a sentence names, which clean-up makes exact.

A diffusion model turns by about what is asked and does an act about as often. Language reads the
numbers out of the sentence, the pipeline hands them on beside the motion, and clean-up edits the
motion by them. Nothing obeys metadata, which tell what was asked and, as `made`, what was done.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Turn:
    """A turn of the whole body that a sentence asks for."""

    degrees: float  # By how much.
    side: str = ""  # `left`, `right`, or nothing for either.


@dataclass(frozen=True)
class Count:
    """Number of repetitions of an act that a sentence asks for."""

    act: str  # A name of `COUNTED`, the acts whose repetitions are measured.
    side: str = ""  # `left`, `right` or `both`, or nothing for any.
    times: int = 1  # Number of times, 1 or more.

    @property
    def wanted(self) -> range:
        """Counts that are as asked: a step more may be the one that ends the walk."""
        return range(self.times, self.times + (2 if self.act == "step" else 1))


@dataclass(frozen=True)
class Corrections:
    """What clean-up makes exact in one motion; by default nothing."""

    turn: Turn | None = None  # The turn, if the sentence names the degrees of exactly one.
    count: Count | None = None  # The count, if the sentence says how often exactly one act is done.
    # Whether it is a whole motion as a model generated it, without much that is quick.
    sharpens: bool = False
    settles: bool = False  # Whether its timing is free, too.
    # Frames that it may have to get longer for rest, where nobody gave its length.
    longest: int = 0
    on_floor: bool = False  # Whether its sentence names nothing above the floor to stand on.

    def about(self) -> dict[str, Any]:
        """Returns what a motion's metadata say of the numbers in its sentence."""
        numbers = {"turn": self.turn, "count": self.count}
        return {name: asdict(each) for name, each in numbers.items() if each is not None}


NO_CORRECTIONS = Corrections()  # Of a motion that nobody asked for a number.
