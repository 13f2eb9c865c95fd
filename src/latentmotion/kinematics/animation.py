"""Animation: rotations of the joints of any skeleton over time, as in motion capture files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError
from latentmotion.kinematics.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.storage.limits import MOST_FRAMES, UNPACKED_FACTOR

MOST_FPS = 1000.0
"""Frames per second above which a rate is taken for a mistake."""


@dataclass(frozen=True, eq=False)
class Animation:
    """Local rotations of a skeleton over time."""

    skeleton: Skeleton
    """The skeleton with these joints."""
    rotations: Float[np.ndarray, "frames joints 3 3"]
    """Rotation of each joint relative to its parent; identity is the rest pose."""
    root_positions: Float[np.ndarray, "frames 3"]
    """Position of the root joint, meters, y up."""
    fps: float
    """Frames per second."""
    translations: Float[np.ndarray, "frames joints 3"] | None = None
    """Animated offsets in place of the skeleton's, in files that move more than the root."""

    def __len__(self) -> int:
        return len(self.rotations)

    def joints(self) -> Float[np.ndarray, "frames joints 3"]:
        """Returns global joint positions, meters."""
        return self.skeleton.forward_kinematics(
            self.rotations, self.root_positions, self.translations
        )

    def resampled(self, fps: float) -> Animation:
        """Returns the animation at another frame rate: frame i is the pose at i / fps seconds.

        Rotations are interpolated by great arcs, so that bones keep their lengths, positions by
        straight lines. The last frame is kept if it falls on the new rate.

        Args:
            fps: Frames per second wanted.

        Raises:
            InputError: `fps` is not a positive number, or far too large.
        """
        check_fps(fps)
        last = len(self) - 1
        if last * fps / self.fps > max(MOST_FRAMES, UNPACKED_FACTOR * last):
            problem = f"{last * fps / self.fps:,.0f} frames from {last + 1:,}"
            raise InputError(f"{problem}; check the frame rates {self.fps:g} and {fps:g}")
        times = np.arange(int(last * fps / self.fps + 1e-6) + 1) * (self.fps / fps)
        before = np.minimum(times.astype(int), max(last - 1, 0))
        after, share = np.minimum(before + 1, last), np.minimum(times - before, 1.0)
        quaternions = quaternion_from_matrix(self.rotations)
        rotations = slerp(quaternions[before], quaternions[after], share[:, None])
        return Animation(
            skeleton=self.skeleton,
            rotations=matrix_from_quaternion(rotations),
            root_positions=_between(self.root_positions, before, after, share[:, None]),
            fps=float(fps),
            translations=None
            if self.translations is None
            else _between(self.translations, before, after, share[:, None, None]),
        )


def check_fps(fps: float) -> None:
    """Raises InputError for a number that is no frame rate."""
    if not (np.isfinite(fps) and 0 < fps <= MOST_FPS):
        raise InputError(f"fps is {fps}, expected a positive number up to {MOST_FPS:g}")


def _between(
    track: np.ndarray, before: np.ndarray, after: np.ndarray, share: np.ndarray
) -> np.ndarray:
    return track[before] * (1 - share) + track[after] * share
