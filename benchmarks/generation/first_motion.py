"""The first motion of a fresh process, for `cold_start.py`: prints the milliseconds of each part.

python -m benchmarks.generation.first_motion ours FOLDER ENGINE THREADS SECONDS STEPS
python -m benchmarks.generation.first_motion authors THREADS SECONDS STEPS
"""

from __future__ import annotations

import json
import sys

from benchmarks.harness.stopwatch import Laps, Stopwatch


def ours(folder: str, engine: str, threads: str, seconds: str, steps: str) -> Laps:
    """Imports, loads, makes a motion and another one."""
    watch = Stopwatch()
    from latentmotion.cli.loading import load_generator

    watch.lap("import")
    generate = load_generator(folder, engine, int(threads))  # type: ignore[arg-type]
    watch.lap("load")
    generate.batch("a person walks forward and kicks", float(seconds), steps=int(steps))
    watch.lap("first motion")
    generate.batch("a person jumps to the left", float(seconds), steps=int(steps))
    watch.lap("second")
    return watch.laps


def authors(threads: str, seconds: str, steps: str) -> Laps:
    """The same in the authors' shapes, whose weights are drawn, not read."""
    watch = Stopwatch()
    import torch

    from benchmarks.generation.authors import AuthorsGeneration

    torch.set_num_threads(int(threads))
    watch.lap("import")
    generate = AuthorsGeneration(1, round(20 * float(seconds)), int(steps))
    watch.lap("load")
    generate()
    watch.lap("first motion")
    generate()
    watch.lap("second")
    return watch.laps


if __name__ == "__main__":
    print(json.dumps({"ours": ours, "authors": authors}[sys.argv[1]](*sys.argv[2:])))
