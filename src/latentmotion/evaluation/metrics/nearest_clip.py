"""Distance to the nearest training clip, which is small if a model repeats its training data.

Two motions are compared pose by pose: root-centered, turned to face the same way (HumanML3D's
root-relative joint positions), over the length of the generated motion, at the offset into the
training clip where they agree best. The distance is the mean over frames and joints, meters.

A joint's mean distance over some frames is at least the distance of its mean positions there
(Jensen's inequality). So means over `_SEGMENT` frames bound the distance from below, and only the
stretches whose bound is below the best distance found are compared frame by frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

_SEGMENT = 8
"""Frames of a mean."""


class TrainingClips:
    """Clips that generated motions are compared with.

    Args:
        clips: Root-relative joints of the training clips, facing +z in every frame, meters.
        stride: Frames between the offsets that are tried; a divisor of 8.
    """

    def __init__(self, clips: Sequence[Float[np.ndarray, "_ joints 3"]], stride: int = 4) -> None:
        self._clips = [np.asarray(clip, np.float32) for clip in clips]
        self._means = [_segment_means(clip, stride) for clip in self._clips]
        self._stride = stride

    def distance(self, motion: Float[np.ndarray, "frames joints 3"]) -> float:
        """Returns the smallest mean joint distance to any stretch of any clip, meters.

        Args:
            motion: Root-relative joints of one motion, facing +z in every frame. A clip that is
                shorter is compared over its own length.
        """
        motion = np.asarray(motion, np.float32)
        means = _segment_means(motion, self._stride)
        candidates = [
            (float(bound), number, offset)
            for number, clip in enumerate(self._clips)
            for offset, bound in enumerate(self._bounds(motion, means, clip, self._means[number]))
        ]
        best = np.inf
        for bound, number, offset in sorted(candidates):
            if bound >= best:
                break
            longer, shorter = _by_length(self._clips[number], motion)
            start = offset * self._stride
            stretch = longer[start : start + len(shorter)]
            best = min(best, float(np.linalg.norm(stretch - shorter, axis=-1).mean()))
        return best

    def _bounds(
        self,
        motion: Float[np.ndarray, "frames joints 3"],
        means: Float[np.ndarray, "starts joints 3"],
        clip: Float[np.ndarray, "_ joints 3"],
        clip_means: Float[np.ndarray, "_ joints 3"],
    ) -> Float[np.ndarray, " offsets"]:
        """Returns a lower bound of the distance at each offset; what no segment covers counts 0."""
        longer, shorter = _by_length(clip, motion)
        moving, still = (clip_means, means) if longer is clip else (means, clip_means)
        offsets = (len(longer) - len(shorter)) // self._stride + 1
        every = _SEGMENT // self._stride
        segments = still[::every]
        if not len(segments):
            return np.zeros(offsets, np.float32)
        rows = np.arange(offsets)[:, None] + every * np.arange(len(segments))
        gaps = np.linalg.norm(moving[rows] - segments, axis=-1).mean(axis=(1, 2))
        return gaps * (_SEGMENT * len(segments) / len(shorter)) - 1e-6


def _by_length(
    clip: Float[np.ndarray, "_ joints 3"], motion: Float[np.ndarray, "frames joints 3"]
) -> tuple[Float[np.ndarray, "_ joints 3"], Float[np.ndarray, "_ joints 3"]]:
    """Returns the longer and the shorter; the clip is the longer of two equal ones."""
    return (clip, motion) if len(clip) >= len(motion) else (motion, clip)


def _segment_means(
    joints: Float[np.ndarray, "frames joints 3"], stride: int
) -> Float[np.ndarray, "starts joints 3"]:
    """Returns the mean pose of every segment that starts at a multiple of `stride`."""
    if len(joints) < _SEGMENT:
        return joints[:0]
    sums = np.cumsum(np.concatenate([np.zeros_like(joints[:1]), joints]), axis=0, dtype=np.float64)
    means = (sums[_SEGMENT:] - sums[:-_SEGMENT])[::stride] / _SEGMENT
    return means.astype(np.float32)
