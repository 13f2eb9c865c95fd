"""Clean-up of generated motion, NumPy only.

    timing  →  turn  →  smoothing  →  bone lengths  →  floor  →  contacts  →  foot lock  →  path

`clean` takes the steps in this order; each is a function from joints to joints that can be used
and measured alone (`benchmarks/quality/cleanup.py`).
"""

from latentmotion.cleanup.foot_lock import FootLock
from latentmotion.cleanup.pipeline import USUAL, CleanUp, CleanUpWarning, clean, clean_batch

__all__ = ["USUAL", "CleanUp", "CleanUpWarning", "FootLock", "clean", "clean_batch"]
