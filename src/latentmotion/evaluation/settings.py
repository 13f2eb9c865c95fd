"""A protocol: how much is measured, from which motions, and by whose habits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal
from zlib import crc32

import numpy as np

from latentmotion.errors import InputError
from latentmotion.evaluation.quirks import AUTHORS, Quirks

ProtocolName = Literal["clean", "paper"]
"""The protocols that are known by name."""


@dataclass(frozen=True)
class Repeats:
    """What MultiModality asks for: many motions of one caption."""

    texts: int = 100
    """Captions, drawn without replacement; all where there are fewer. 0 leaves the metric out."""
    samples: int = 10
    """Motions of each."""
    pairs: int | None = None
    """Pairs of them that are compared, the same for all captions; null for all pairs."""
    replications: int = 5
    """Replications that measure it; it needs the most motions of all metrics."""


@dataclass(frozen=True)
class Protocol:
    """How a model is measured."""

    name: str
    """What reports call it."""
    split: str = "test"
    """Split that is asked for."""
    replications: int = 20
    """Times that everything is repeated with other random numbers."""
    seed: int = 0
    """All randomness derives from it, the replication and the item."""
    group: int = 32
    """Motions among which R-precision ranks."""
    repeats: Repeats = field(default_factory=Repeats)
    """MultiModality of captions."""
    max_frames: int | None = None
    """Longest motion; by default the model's own."""
    unit: int = 4
    """Lengths are multiples of this, as text-motion evaluators look at four frames at a time;
    motions of actions keep their length."""
    nearest_clip: bool = True
    """Whether the distance to the nearest training clip, which is slow, is measured; in the first
    replication only."""
    quirks: Quirks = field(default_factory=Quirks)
    """What is done as in the authors' code."""

    def __post_init__(self) -> None:
        if self.replications < 1:
            raise InputError(f"{self.replications} replications: expected 1 or more")
        if self.seed < 0 or self.repeats.texts < 0:
            raise InputError(
                f"seed {self.seed}, {self.repeats.texts} captions of many motions: expected 0 or "
                "more"
            )
        if self.group < 2 or self.unit < 1:
            raise InputError(f"group {self.group}, unit {self.unit}: expected 2, 1 or more")

    def generator(self, purpose: str, replication: int, *item: int) -> np.random.Generator:
        """Returns the source of randomness of one purpose in a replication, or in an item of it."""
        return np.random.default_rng([self.seed, crc32(purpose.encode()), replication, *item])

    def seeds(self, purpose: str, replication: int, count: int, *item: int) -> list[int]:
        """Returns one seed per motion; each depends on nothing but the protocol's and its place."""
        start = (self.seed, crc32(purpose.encode()), replication, *item)
        sequences = (np.random.SeedSequence([*start, number]) for number in range(count))
        return [int(sequence.generate_state(1)[0]) for sequence in sequences]


CLEAN = Protocol("clean")
"""The default."""

PAPER = Protocol(
    "paper",
    repeats=Repeats(texts=100, samples=30, pairs=10, replications=20),
    quirks=AUTHORS,
)
"""The authors' evaluation, for figures to stand beside those of papers."""

PROTOCOLS: dict[ProtocolName, Protocol] = {"clean": CLEAN, "paper": PAPER}
"""Each by its name."""
