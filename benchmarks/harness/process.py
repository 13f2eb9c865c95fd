"""A command as a process of its own: what the operating system says it took.

A script too, `python process.py COMMAND …`, since a process's peak of memory begins with that of
the one that starts it, which must be small.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Cost:
    """What a finished process took."""

    clock: float  # Seconds from start to end.
    processor: float  # Seconds of all its threads together, in the system too.
    memory: float  # Peak, in MB.
    said: str  # What it printed.


def cost(command: Sequence[str], **environment: str) -> Cost:
    """Runs a command, in an environment with some variables set, and returns what it took.

    Raises:
        subprocess.CalledProcessError: It failed; what it complained about is on standard error.
    """
    middle = [sys.executable, __file__, *command]
    variables = {**os.environ, **environment}
    found = subprocess.run(middle, check=True, stdout=subprocess.PIPE, text=True, env=variables)
    return Cost(**json.loads(found.stdout))


def _run(command: Sequence[str]) -> Cost:
    start = time.perf_counter()
    said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    clock, usage = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    unit = 1e6 if sys.platform == "darwin" else 1e3  # macOS counts bytes, Linux kilobytes
    return Cost(clock, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / unit, said)


if __name__ == "__main__":
    print(json.dumps(vars(_run(sys.argv[1:]))))
