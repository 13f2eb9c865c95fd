"""Arrays of NumPy and PyTorch alike: their common functions, prefix masks, unit vectors.

NumPy implements the array API itself since 2.1. array-api-compat, which is for PyTorch and older
NumPy, imports the whole of NumPy to wrap it: 150 ms of processor time before the first motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import array_api_compat
import numpy as np
from array_api_compat import device as device
from jaxtyping import Bool, Float, Int, Shaped

_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])
_NUMPY_HAS_ARRAY_API = hasattr(np, "unstack")  # its last function to arrive, in 2.1


def array_namespace(*arrays: Any) -> Any:
    """Returns the module with the array API's functions for the arrays."""
    if _NUMPY_HAS_ARRAY_API and all(
        isinstance(array, (np.ndarray, np.generic)) for array in arrays
    ):
        return np
    return array_api_compat.array_namespace(*arrays)


def prefix_mask(
    lengths: Sequence[int] | Int[Any, " batch"], longest: int | None = None
) -> Bool[Any, "batch longest"]:
    """Returns a row per length, True up to it: the real frames, tokens or words of a padded batch.

    Args:
        lengths: A list, for a NumPy mask, or an array, for a mask of its library on its device.
        longest: Width of the mask; by default the largest length.
    """
    counts: Any = np.asarray(lengths) if isinstance(lengths, Sequence) else lengths
    xp = array_namespace(counts)
    width = int(xp.max(counts)) if longest is None else longest
    return xp.arange(width, device=device(counts)) < counts[:, None]


def dot(
    a: Float[np.ndarray, "*#batch width"], b: Float[np.ndarray, "*#batch width"]
) -> Float[np.ndarray, "*batch"]:
    """Returns the dot products of vectors, in a third of the time of `numpy.sum`."""
    return np.asarray(np.einsum("...n,...n->...", a, b))


def perpendicular(
    vectors: Float[np.ndarray, "*#batch width"], axis: Float[np.ndarray, "*#batch width"]
) -> Float[np.ndarray, "*batch width"]:
    """Returns what of vectors is perpendicular to an axis of length 1."""
    return vectors - axis * dot(vectors, axis)[..., None]


def length(vectors: Float[np.ndarray, "*batch width"]) -> Float[np.ndarray, "*batch"]:
    """Returns the lengths of vectors, in a third of the time of `numpy.linalg.norm`."""
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def unit(vectors: Float[np.ndarray, "*batch width"]) -> Float[np.ndarray, "*batch width"]:
    """Returns vectors of length 1 in the same directions; those of length 0 stay 0."""
    return vectors / np.maximum(length(vectors), 1e-12)[..., None]


def cross(
    a: Float[np.ndarray, "*#batch 3"], b: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Returns the cross product, in a third of the time of `numpy.cross`."""
    left = a.take(_YZX, axis=-1) * b.take(_ZXY, axis=-1)
    return left - a.take(_ZXY, axis=-1) * b.take(_YZX, axis=-1)


# Frames of each motion of a padded batch; None where none has padding. Frames come first, then
# motions; what a function returns beyond the last frame of a motion means nothing.
Lengths = Int[np.ndarray, " motions"] | None


def real_frames(lengths: Lengths, frames: int) -> Bool[np.ndarray, "frames motions"]:
    """Returns a column per motion of a padded batch, True on its frames; one column for all."""
    return np.ones((frames, 1), bool) if lengths is None else prefix_mask(lengths, frames).T


def held(values: Shaped[np.ndarray, "n ..."], lengths: Lengths) -> Shaped[np.ndarray, "n ..."]:
    """Returns a copy of a padded batch whose motions stay as they are in their last frame."""
    if lengths is None:
        return values.copy()
    rows = np.minimum(np.arange(len(values))[:, None], lengths - 1)
    return values[rows, np.arange(len(lengths))]


def quantile(
    values: Float[np.ndarray, "n ..."], share: float, lengths: Lengths = None
) -> Float[np.ndarray, "*batch"]:
    """Returns a quantile along the first axis, linear between two numbers.

    `numpy.quantile` is the same and takes ten times as long for arrays as short as motions.
    """
    if lengths is not None:
        return np.stack([quantile(values[:n, k], share) for k, n in enumerate(lengths.tolist())])
    ordered, position = np.sort(values, axis=0), share * (len(values) - 1)
    lower = int(position)
    upper = min(lower + 1, len(values) - 1)
    return np.asarray(ordered[lower] + (position - lower) * (ordered[upper] - ordered[lower]))


def running_maximum(values: Shaped[np.ndarray, "n ..."], width: int) -> Shaped[np.ndarray, "m ..."]:
    """Returns the maxima of so many successive rows, as many rows less as a maximum has further.

    A maximum of few rows gives that of twice as many, so 32 rows take five steps.
    """
    most, rows = values, 1
    while rows < width:
        further = min(rows, width - rows)
        most, rows = np.maximum(most[:-further], most[further:]), rows + further
    return most
