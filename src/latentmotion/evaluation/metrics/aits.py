"""AITS: average inference time per sentence, in seconds.

The time from a sentence (label, nothing) to features in their own units: condition, all sampling
steps with guidance, decoder; one motion at a time. Loading, joints and files are not in it. MLD,
section 4.4. The authors' timer does not wait for the GPU (mld.md §11); this one does, and what runs
for the first time is not timed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import fmean

import torch

WARM_UP = 3
"""Motions that are made before the clock starts."""


def aits(actions: Sequence[Callable[[], object]], warm_up: int = WARM_UP) -> float:
    """Returns the mean time of actions, each of which makes one motion.

    Args:
        actions: What is timed.
        warm_up: How many of them, from the first, are run once before.
    """
    for action in actions[:warm_up]:
        action()
    return fmean([_seconds(action) for action in actions])


def _seconds(action: Callable[[], object]) -> float:
    _wait()
    start = time.perf_counter()
    action()
    _wait()
    return time.perf_counter() - start


def _wait() -> None:
    if torch.cuda.is_available():
        torch.cuda.synchronize()
