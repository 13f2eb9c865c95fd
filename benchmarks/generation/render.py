"""How long a picture or a video of 4 seconds of motion takes: the whole command, a new process.

    python -m benchmarks.generation.render   # the table in lab/diary/performance.md

CPU seconds are those of all threads of the command, system time included; on a busy machine they
say more than the clock does. Medians of a few runs.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from benchmarks.harness.contest import figure, table
from benchmarks.harness.process import Cost, cost

CLOCKS = ("clock", "processor")

RENDERINGS = {
    "MP4": ("a.mp4",),
    "GIF": ("a.gif",),
    "MP4, still camera": ("a.mp4", "--camera", "still"),
    "MP4, 30 fps": ("a.mp4", "--fps", "30"),
    "strip, row": ("a.png",),
    "strip, path": ("a.png", "--style", "path"),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--turns", type=int, default=3)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        motion = f"{name}/walk.npz"
        caption = "a person walks forward and kicks"
        _run("generate", caption, "--seconds", str(options.seconds), "-o", motion)
        rows = []
        for label, (file, *more) in RENDERINGS.items():
            target = Path(name) / file
            size = [] if file.endswith(".png") else ["--size", str(options.size)]
            words = ["render", motion, "-o", str(target), *more, *size]
            costs = [_run(*words) for _ in range(options.turns)]
            clock, processor = (median(getattr(c, of) for c in costs) for of in CLOCKS)
            kilobytes = f"{target.stat().st_size / 1000:.0f}"
            rows.append([label, figure(clock), figure(processor), kilobytes])
    print(table(["", "clock, s", "CPU, s", "file, kB"], rows))


def _run(*words: str) -> Cost:
    return cost([sys.executable, "-m", "latentmotion", *words])


if __name__ == "__main__":
    main()
