"""How long a sentence takes from nothing: fresh processes, in turn, and their peak of memory.

    python -m benchmarks.generation.cold_start --models starter fast

"import", "load" and "first motion" are of a Python process that makes one motion; "whole command"
is `latentmotion generate … --no-cache -o walk.bvh`, from its start to its end, clean-up and file
included. Networks are loaded when they are first needed, much of it in the first motion.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from functools import partial

import torch

from benchmarks.generation.ours import Model, entries, label, options_parser
from benchmarks.harness.contest import Contender, figure, table, take_turns
from benchmarks.harness.process import cost
from benchmarks.harness.stopwatch import Laps
from latentmotion.cli.options import Runtime

COLUMNS = ("import", "load", "first motion", "whole command", "peak memory")
PYTHON = sys.executable


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    options = options_parser(__doc__).parse_args(arguments)
    torch.set_num_threads(max(options.threads))  # of this process, which says what was measured
    print(report(options, options.turns))


def report(options: argparse.Namespace, turns: int) -> str:
    """Returns the table, of the highest number of threads that was asked for."""
    with tempfile.TemporaryDirectory() as folder:
        contenders: dict[str, Contender] = {
            f"authors' shapes, {options.steps} steps": partial(_authors, options)
        }
        for model, engine in entries(options):
            name = label(model, engine, max(model.steps(options.steps)))
            contenders[name] = partial(_ours, options, model, engine, folder)
        times = take_turns(contenders, turns)
    rows = [[name, *(figure(times.part(name, part)) for part in COLUMNS)] for name in contenders]
    columns = [*(f"{column}, ms" for column in COLUMNS[:-1]), "peak memory, MB"]
    return f"{times}\n\n{table(['a fresh process', *columns], rows)}"


def _authors(options: argparse.Namespace) -> Laps:
    threads, length, steps = max(options.threads), options.seconds, options.steps
    return _first(["authors", str(threads), str(length), str(steps)], threads)


def _ours(options: argparse.Namespace, model: Model, engine: Runtime, folder: str) -> Laps:
    threads, steps = max(options.threads), max(model.steps(options.steps))
    ask = ["--seconds", str(options.seconds), "--steps", str(steps)]
    run = ["--model", str(model.folder), "--runtime", engine, "--threads", str(threads)]
    asked = ["generate", "a person walks and kicks", "--no-cache"]
    command = [*asked, *ask, *run, "-o", f"{folder}/walk.bvh"]
    whole = cost([PYTHON, "-m", "latentmotion", *command], OMP_NUM_THREADS=str(threads))
    first = ["ours", str(model.folder), engine, str(threads), str(options.seconds), str(steps)]
    laps = _first(first, threads)
    return laps | {"whole command": 1e3 * whole.clock, "peak memory": whole.memory}


def _first(arguments: Sequence[str], threads: int) -> Laps:
    command = [PYTHON, "-m", "benchmarks.generation.first_motion", *arguments]
    found = cost(command, OMP_NUM_THREADS=str(threads))
    return {**json.loads(found.said), "peak memory": found.memory}


if __name__ == "__main__":
    main()
