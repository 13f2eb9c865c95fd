"""Native frame rates of CMU's trials, which their AMC files do not tell: 120, and 60 for these."""

from __future__ import annotations

USUAL = 120.0
SLOW = 60.0

_SLOW_SUBJECTS = frozenset(
    (60, 61, 62, 74, 75, 77, 79, 80, 84, 88, 93, 103, 106, 107, 115, 139, 141, 143)
)
_SLOW_TRIALS = frozenset(("89_01", "90_08", "90_11"))
_FAST_TRIALS = frozenset(("74_09", "77_21", "77_28", "84_09", "88_03", "139_21"))


def native_fps(trial: str) -> float:
    """Returns the frames per second of a trial such as `05_18`."""
    is_slow = int(trial.split("_")[0]) in _SLOW_SUBJECTS and trial not in _FAST_TRIALS
    return SLOW if is_slow or trial in _SLOW_TRIALS else USUAL
