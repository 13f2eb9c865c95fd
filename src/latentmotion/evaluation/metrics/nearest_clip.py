"""Distance to the nearest training clip: does a model invent, or repeat what it has seen?

Two motions are compared pose by pose: root-centered, turned to face the same way (HumanML3D's
root-relative joint positions), over the length of the generated motion, at the offset into the
training clip where they agree best. The distance is the mean over frames and joints, meters.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


def nearest_clip_distance(
    motion: Float[np.ndarray, "frames joints 3"],
    clips: Sequence[Float[np.ndarray, "_ joints 3"]],
    stride: int = 4,
) -> float:
    """Returns the smallest mean joint distance to any stretch of any clip, meters.

    Args:
        motion: Root-relative joints of one motion, facing +z in every frame.
        clips: The same of the training clips; one shorter than the motion is compared over its own
            length.
        stride: Frames between the offsets that are tried.
    """
    return min(_distance(motion, clip, stride) for clip in clips)


def _distance(
    motion: Float[np.ndarray, "frames joints 3"],
    clip: Float[np.ndarray, "_ joints 3"],
    stride: int,
) -> float:
    length = min(len(motion), len(clip))
    longer, shorter = (clip, motion) if len(clip) >= len(motion) else (motion, clip)
    starts = range(0, len(longer) - length + 1, stride)
    windows = np.stack([longer[start : start + length] for start in starts])
    return float(np.linalg.norm(windows - shorter, axis=-1).mean(axis=(1, 2)).min())
