"""What a file that holds a rig must offer: its skeleton as it is, and a way to write takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Take:
    """One animation, in axes and unit of the file that it goes into."""

    name: str
    """What it is called there."""
    animation: Animation
    """Of the file's own skeleton."""


@runtime_checkable
class RigFile(Protocol):
    """A file with a skeleton, unchanged since it was read."""

    @property
    def path(self) -> Path:
        """Where it was read."""
        ...

    @property
    def skeleton(self) -> Skeleton:
        """Its joints in rest pose, in the file's own axes and unit."""
        ...

    @property
    def root(self) -> Float[np.ndarray, " 3"]:
        """Where joint 0 rests."""
        ...

    @property
    def unit(self) -> float | None:
        """Meters per unit, where the file says so."""
        ...

    @property
    def movable(self) -> frozenset[int]:
        """Joints that may move besides turning."""
        ...

    @property
    def declared(self) -> Mapping[str, int]:
        """Joints by their names in VRM's humanoid, where the file says them."""
        ...

    @property
    def endings(self) -> tuple[str, ...]:
        """Endings that `write` can write."""
        ...

    def write(self, path: Path, takes: Sequence[Take]) -> list[Path]:
        """Writes the file again, with these takes."""
        ...
