"""Which action can follow which: poses at the ends of all parts, compared as the body sees them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from latentmotion.data.composable import Part, interest
from latentmotion.data.splicing import pose_descriptors
from latentmotion.representation.interface import Representation

_SEAMS = 8
"""Places at which a part may end, and as many at which it may begin."""


def rarity(parts: Sequence[Part]) -> Float[np.ndarray, " parts"]:
    """Returns how often each part is drawn, so that frequent actions do not crowd out the rest."""
    frequency = Counter(part.verbs for part in parts)
    weights = np.array([frequency[part.verbs] ** -0.7 for part in parts])
    return weights / weights.sum()


class Pairing:
    """Finds parts that begin nearly as another ends.

    Args:
        parts: What may follow.
        representation: Says the frame rate and the skeleton.
        generator: Source of every choice.
        distance: Largest distance of poses with their speeds, meters.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        representation: Representation,
        generator: np.random.Generator,
        distance: float,
    ) -> None:
        self.parts, self.representation = parts, representation
        self.generator, self.distance, self.rarity = generator, distance, rarity(parts)
        beginnings = [self._beginnings(part) for part in parts]
        self.owners = np.repeat(np.arange(len(parts)), [len(frames) for frames, _ in beginnings])
        self.poses = np.concatenate([poses for _, poses in beginnings]).astype(np.float32)
        self.frames = np.concatenate([frames for frames, _ in beginnings])

    def follower(
        self, first: Part, allowed: Bool[np.ndarray, " parts"]
    ) -> tuple[Part, int, int] | None:
        """Returns a part, the frame at which the first ends and at which the part begins.

        Args:
            first: What comes first.
            allowed: Which parts may follow.
        """
        ends = self._ends(first)
        poses = self._poses(first, ends)
        distance = _distances(poses.astype(np.float32), self.poses)
        distance[:, ~allowed[self.owners]] = np.inf
        best = np.full(len(self.parts), np.inf)
        np.minimum.at(best, self.owners, distance.min(axis=0))
        near = np.flatnonzero(best < self.distance)
        if not len(near):
            return None
        wanted = np.array([interest(first, self.parts[n]) for n in near.tolist()])
        weights = wanted * self.rarity[near] / (0.05 + best[near])
        chosen = int(self.generator.choice(near, p=weights / weights.sum()))
        columns = np.flatnonzero(self.owners == chosen)
        row, column = np.unravel_index(distance[:, columns].argmin(), (len(ends), len(columns)))
        return self.parts[chosen], int(ends[row]), int(self.frames[columns[column]])

    def _ends(self, part: Part) -> Int[np.ndarray, " chosen"]:
        """Returns frames at which a part may end: late ones, or any of a steady movement."""
        last = len(part.joints) - 1
        earliest = part.least if part.steady else last - part.slack
        return self._some(earliest, last)

    def _beginnings(
        self, part: Part
    ) -> tuple[Int[np.ndarray, " chosen"], Float[np.ndarray, "chosen numbers"]]:
        latest = len(part.joints) - 1 - part.least if part.steady else part.slack
        frames = self._some(0, max(latest, 0))
        return frames, self._poses(part, frames)

    def _some(self, first: int, last: int) -> Int[np.ndarray, " chosen"]:
        frames = np.arange(first, last + 1)
        if len(frames) > _SEAMS:
            frames = np.sort(self.generator.choice(frames, _SEAMS, replace=False))
        return frames

    def _poses(
        self, part: Part, frames: Int[np.ndarray, " chosen"]
    ) -> Float[np.ndarray, "chosen numbers"]:
        representation = self.representation
        return pose_descriptors(part.joints, representation.fps, representation.skeleton, frames)


def _distances(
    some: Float[np.ndarray, "some numbers"], others: Float[np.ndarray, "others numbers"]
) -> Float[np.ndarray, "some others"]:
    squares = (some**2).sum(1)[:, None] + (others**2).sum(1) - 2 * some @ others.T
    return np.sqrt(np.maximum(squares, 0))
