"""Changes: what a clean-up did to a motion, in one line of figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.kinematics.plausibility import foot_sliding
from latentmotion.motion import Motion

_FAR, _OFF = 0.1, 0.05
"""Meters that joints may move on average, and share of the path's length that may change, without
a warning."""


@dataclass(frozen=True)
class Changes:
    """How a motion differs from what it was."""

    lifted: float
    """Meters by which the whole figure was lifted onto the floor, or lowered."""
    mean: float
    """Meters that a joint moved besides, on average."""
    most: float
    """Meters that a joint moved at most."""
    path: float
    """Length of the path along the floor, as a share of what it was, less 1."""
    lowest: tuple[float, float]
    """Height of the lowest joint before and after, meters."""
    sliding: tuple[float, float]
    """Mean speed of standing feet before and after, m/s."""

    @classmethod
    def of(cls, before: Motion, after: Motion) -> Changes:
        """Compares two motions of one skeleton, frame by frame as far as both go."""
        count = min(len(before), len(after))
        moved = after.joints[:count] - before.joints[:count]
        lifted = float(np.median(moved[..., 1]))
        moved = np.linalg.norm(moved - np.array([0, lifted, 0]), axis=-1)
        old, new = (_path_length(one.joints[:count], one.fps) for one in (before, after))
        return cls(
            lifted,
            float(moved.mean()),
            float(moved.max()),
            new / old - 1 if old > _SHORT else 0.0,
            (float(before.joints[..., 1].min()), float(after.joints[..., 1].min())),
            (_sliding(before), _sliding(after)),
        )

    @property
    def text(self) -> str:
        """All figures, in one line."""
        (low, lower), (slid, slides) = self.lowest, self.sliding
        lift = f"lifted {100 * self.lifted:+.1f} cm; " if abs(self.lifted) > _LIFTED else ""
        return (
            f"{lift}joints moved {100 * self.mean:.1f} cm on average, at most "
            f"{100 * self.most:.1f} cm; lowest point {100 * low:.1f} → {100 * lower:.1f} cm; "
            f"feet slide {100 * slid:.1f} → {100 * slides:.1f} cm/s; path {self.path:+.1%}"
        )

    @property
    def problem(self) -> str | None:
        """What is more than a clean-up should change, if anything is."""
        if self.mean > _FAR:
            return (
                f"joints moved {100 * self.mean:.0f} cm on average, more than {100 * _FAR:.0f}: "
                "look at the result, and check unit, axes and floor of the file"
            )
        if abs(self.path) > _OFF:
            return f"the path changed by {self.path:+.0%}, more than {_OFF:.0%}: look at the result"
        return None


_LIFTED = 0.005
"""Meters of the whole figure that are told."""

_SHORT = 0.5
"""Meters of a path whose change of length says nothing."""


def _path_length(joints: Float[np.ndarray, "frames joints 3"], fps: float) -> float:
    """Returns the length of the root's path along the floor, in steps of a quarter of a second."""
    path = joints[:: max(1, round(fps / 4)), 0, ::2]
    return float(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum())


def _sliding(motion: Motion) -> float:
    return foot_sliding(motion.joints, motion.fps, motion.skeleton, floor_under(motion.joints))


def floor_under(joints: Float[np.ndarray, "frames joints 3"]) -> float:
    """Returns the height of what feet stand on, roughly: where the lowest joint is often."""
    return float(np.percentile(joints[..., 1].min(axis=1), 5))
