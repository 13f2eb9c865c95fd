"""Edits: settings of a take that are applied whenever its motion is read, never stored in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from latentmotion.cleanup.pipeline import in_place
from latentmotion.errors import InputError
from latentmotion.motion import Motion

SLOWEST, FASTEST = 0.1, 10.0
"""Least and greatest speed."""


@dataclass(frozen=True)
class Edits:
    """How a stored motion is shown and written: first in place, then trimmed, mirrored, sped up.

    Raises:
        InputError: A number is out of range.
    """

    trim: tuple[float, float] | None = None
    """Start and end, seconds of the stored motion."""
    speed: float = 1.0
    """Playback speed factor: the frames stay, their rate changes."""
    in_place: bool = False
    """Without root motion along the floor."""
    mirrored: bool = False
    """Left and right are swapped."""

    def __post_init__(self) -> None:
        if not SLOWEST <= self.speed <= FASTEST:
            raise InputError(f"speed {self.speed:g}: expected {SLOWEST:g} to {FASTEST:g}")

    def applied(self, motion: Motion) -> Motion:
        """Returns an edited motion; without edits the same.

        Raises:
            InputError: There is no frame between the times of the trim.
        """
        if self.in_place:
            joints = in_place(motion.joints.astype(np.float64), motion.fps).astype(np.float32)
            motion = replace(motion, joints=joints)
        if self.trim is not None:
            motion = motion.cut(*self.trim)
        if self.mirrored:
            motion = motion.mirrored()
        return replace(motion, fps=motion.fps * self.speed) if self.speed != 1 else motion

    def length(self, frames: int, fps: float) -> tuple[int, float]:
        """Returns frames and frames per second of a motion of such a length once it is edited.

        Raises:
            InputError: There is no frame between the times of the trim.
        """
        start, end = self.trim or (0.0, frames / fps)
        first, stop = round(start * fps), round(end * fps)
        if not 0 <= first < stop <= frames:
            raise InputError(
                f"trim from {start:g} to {end:g} s: expected times in order, from 0 to "
                f"{frames / fps:g} s, at least a frame apart"
            )
        return stop - first, fps * self.speed
