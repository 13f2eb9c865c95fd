"""How long a sentence takes, part by part: the authors' shapes, MDM's, and our models.

    python -m benchmarks.generation.speed --models starter fast --int8 fast-int8=FOLDER

All contenders take turns. From sentences to joints in memory, networks warm: "text" is all that
becomes of sentences before sampling, "denoiser" all sampling steps with guidance, "joints" the way
from features to positions, "processor" what all threads had of it. Then the tables of `files.py`
and `cold_start.py`. The authors' shapes and MDM's are a reference for time alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch

from benchmarks.generation import cold_start, files
from benchmarks.generation.authors import AuthorsGeneration
from benchmarks.generation.mdm import MDMGeneration
from benchmarks.generation.ours import Generation, entries, label, options_parser
from benchmarks.harness.contest import Contender, Times, figure, table, take_turns
from latentmotion.cli.loading import load_generator

PARTS = ("text", "denoiser", "decoder", "joints")


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table for each number of threads and motions, then those of files and cold start."""
    parser = options_parser(__doc__)
    parser.add_argument("--batches", nargs="*", type=int, default=[1, 32])
    parser.add_argument("--patience", type=float, default=60.0, help="seconds for one contender")
    parser.add_argument("--processes", type=int, default=3, help="turns of a cold start, or 0")
    options = parser.parse_args(arguments)
    for threads in options.threads:
        torch.set_num_threads(threads)
        for batch in options.batches:
            contenders = dict(_contenders(options, threads, batch))
            times = take_turns(contenders, options.turns, options.patience)
            print(f"\n{_asked(options, batch)}\n\n{times}\n\n{_table(times, batch)}", flush=True)
    if options.processes:
        print(f"\n{files.report(options.models[-1], options.seconds, options.turns)}", flush=True)
        print(f"\n{cold_start.report(options, options.processes)}")


def _contenders(
    options: argparse.Namespace, threads: int, batch: int
) -> Iterator[tuple[str, Contender]]:
    frames, steps = round(20 * options.seconds), options.steps
    yield f"authors' shapes, {steps} steps", AuthorsGeneration(batch, frames, steps)
    run, few = max(steps // batch, 1), max(steps // batch // 5, 1)
    mdm = MDMGeneration.build(batch, frames, steps, run)
    yield f"MDM's shape, {steps} steps{_reckoned(run, steps)}", mdm
    yield f"MDM's shape, 1000 steps{_reckoned(few, 1000)}", replace(mdm, steps=1000, run=few)
    for model, engine in entries(options):
        generator = load_generator(model.folder, engine, threads)
        for count in model.steps(steps):
            contender = Generation(generator, batch, options.seconds, count)
            yield label(model, engine, count), contender


def _reckoned(run: int, steps: int) -> str:
    return "" if run == steps else f" (reckoned from {run})"


def _asked(options: argparse.Namespace, batch: int) -> str:
    motions = "one motion" if batch == 1 else f"{batch} motions together"
    return f"Milliseconds for {motions} of {options.seconds:g} s"


def _table(times: Times, batch: int) -> str:
    each = ["a motion"] if batch > 1 else []
    return table(
        ["", *PARTS, "in all", *each, "times as fast", "processor"],
        [_row(times, name, batch) for name in times.turns],
    )


def _row(times: Times, name: str, batch: int) -> list[str]:
    whole, ratio = times.whole(name), figure(times.ratio(name))
    parts = [figure(times.part(name, part)) for part in PARTS]
    each = [figure(whole / batch)] if batch > 1 else []
    return [name, *parts, f"**{figure(whole)}**", *each, ratio, figure(times.processor(name))]


if __name__ == "__main__":
    main()
