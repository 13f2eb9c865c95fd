"""Bulk generation: what many motions cost, by their number and by the number of processes.

    python -m benchmarks.generation.bulk 512 2048 10000 --processes 1 2

Each line is `latentmotion bulk` on prompts of which no two are the same, clean-up and files
included, its processes started together. "processor" is the time of all of them, without that of a
run of one motion, which is what starting costs. The last column reckons a million motions from it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path

from benchmarks.generation.ours import sentences
from benchmarks.harness.contest import table
from benchmarks.harness.process import cost
from latentmotion.networks.device import describe_machine
from latentmotion.storage.shards import check, folder_at

COLUMNS = (
    *("motions", "processes", "MB", "clock, s", "motions/s"),
    *("processor, ms a motion", "a million, core-hours"),
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("counts", type=int, nargs="+", help="numbers of motions")
    parser.add_argument("--processes", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--options", nargs="*", default=[], help="of latentmotion bulk, as k=v")
    options = parser.parse_args(arguments)
    words = [f"--{option}" for option in options.options]
    start = _run(1, 1, words)[1]
    rows = []
    for count in options.counts:
        for processes in options.processes:
            clock, processor, size = _run(count, processes, words)
            each = 1e3 * (processor - processes * start) / count
            figures = [size / 1e6, clock, count / clock, each, each * 1e3 / 3600]
            rows.append([str(count), str(processes), *(f"{figure:.3g}" for figure in figures)])
    print(f"{describe_machine()}; starting a process takes {start:.2f} s of processor time\n")
    print(table(COLUMNS, rows))


def _run(count: int, processes: int, words: list[str]) -> tuple[float, float, int]:
    """Returns seconds of the clock and of the processors, and the bytes that were written."""
    with tempfile.TemporaryDirectory() as folder:
        prompts, output = Path(folder) / "prompts.txt", str(Path(folder) / "motions")
        prompts.write_text("\n".join(islice(sentences(), count)) + "\n", encoding="utf-8")
        command = [sys.executable, "-m", "latentmotion", "bulk", str(prompts), "-o", output]
        commands = [
            [*command, *words, f"--shard={number}/{processes}"]
            for number in range(1, processes + 1)
        ]
        begin = time.perf_counter()
        with ThreadPoolExecutor(processes) as pool:
            processor = sum(spent.processor for spent in pool.map(cost, commands))
        clock = time.perf_counter() - begin
        manifest = check(folder_at(output))
        assert sum(record.items for record in manifest.shards) == count
        return clock, processor, sum(record.size for record in manifest.shards)


if __name__ == "__main__":
    main()
