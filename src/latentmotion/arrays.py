"""NumPy or PyTorch, whichever an array is of: what both rings need is written once for both.

NumPy 2.1 speaks the array API itself. array-api-compat, which is for PyTorch and for older NumPy,
imports the whole of NumPy to wrap it: 150 ms of the processor's time before the first motion.
"""

from __future__ import annotations

from typing import Any

import array_api_compat
import numpy as np
from array_api_compat import device as device

_SPEAKS_IT = hasattr(np, "unstack")  # the last of it to come, in 2.1


def array_namespace(*arrays: Any) -> Any:
    """Returns the module with the array API's functions for the arrays."""
    if _SPEAKS_IT and all(isinstance(array, (np.ndarray, np.generic)) for array in arrays):
        return np
    return array_api_compat.array_namespace(*arrays)
