"""A clock for the parts of a work; a module of its own, since it must cost no import."""

from __future__ import annotations

import time

Laps = dict[str, float]  # Milliseconds by part.


class Stopwatch:
    """Milliseconds of one part after another, from when it was made."""

    def __init__(self) -> None:
        self.laps: Laps = {}
        self._start = time.perf_counter()

    def lap(self, part: str) -> None:
        """Ends a part and begins the next."""
        now = time.perf_counter()
        self.laps[part] = 1e3 * (now - self._start)
        self._start = now
