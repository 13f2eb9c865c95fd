"""How long a picture or a video of 4 seconds of motion takes: the whole command, a new process.

    python benchmarks/render.py              # the table in docs/render.md

CPU seconds are those of all threads of the command, system time included; on a busy machine they
say more than the clock does. Medians of a few runs.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RENDERINGS = {
    "MP4": ("a.mp4",),
    "GIF": ("a.gif",),
    "MP4, still camera": ("a.mp4", "--camera", "still"),
    "MP4, 30 fps": ("a.mp4", "--fps", "30"),
    "strip, row": ("a.png",),
    "strip, path": ("a.png", "--style", "path"),
}


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        motion = str(Path(name) / "walk.npz")
        caption = "a person walks forward and kicks"
        _run("generate", caption, "--seconds", str(options.seconds), "-o", motion)
        print("| | clock, s | CPU, s | file, kB |\n|---|---|---|---|")
        for label, (file, *more) in RENDERINGS.items():
            target = Path(name) / file
            size = [] if file.endswith(".png") else ["--size", str(options.size)]
            words = ["render", motion, "-o", str(target), *more, *size]
            costs = [_run(*words) for _ in range(options.repeats)]
            clock, cpu = (statistics.median(each) for each in zip(*costs, strict=True))
            print(f"| {label} | {clock:.1f} | {cpu:.1f} | {target.stat().st_size / 1000:.0f} |")


def _run(*words: str) -> tuple[float, float]:
    """Returns seconds by the clock and of the processor."""
    start, before = time.perf_counter(), _spent()
    subprocess.run([sys.executable, "-m", "latentmotion", *words], check=True, capture_output=True)
    return time.perf_counter() - start, _spent() - before


def _spent() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
