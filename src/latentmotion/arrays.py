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
from jaxtyping import Bool, Float, Int

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


def unit(vectors: Float[np.ndarray, "*batch width"]) -> Float[np.ndarray, "*batch width"]:
    """Returns vectors of length 1 in the same directions; those of length 0 stay 0."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
