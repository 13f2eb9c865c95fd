"""How time grows with the length of a motion, with how many are made together, and with steps.

    python -m benchmarks.generation.growth --models starter fast --engines openvino

Under each table is the straight line that fits it best: what one call costs however small it is,
and what each second, motion or step adds. Lengths beyond what a model makes are cut.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from benchmarks.generation.ours import Generation, Model, entries, label, options_parser
from benchmarks.harness.contest import figure, table, take_turns
from latentmotion.cli.loading import load_generator
from latentmotion.pipeline import MotionPipeline


@dataclass(frozen=True)
class Axis:
    """What grows."""

    name: str  # As the table calls it.
    unit: str  # One of it.
    values: Sequence[float]  # What is timed.
    make: Callable[[float], Generation]  # Returns the contender for a value.


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints three small tables for each model and engine."""
    parser = options_parser(__doc__)
    parser.set_defaults(engines=["openvino"])
    parser.add_argument("--lengths", nargs="*", type=float, default=[2.0, 4.0, 6.0, 8.0, 10.0])
    parser.add_argument("--batches", nargs="*", type=int, default=[1, 4, 16, 64, 256])
    parser.add_argument("--counts", nargs="*", type=int, default=[1, 2, 5, 10, 20, 50])
    parser.add_argument("--patience", type=float, default=30.0, help="seconds for one contender")
    options = parser.parse_args(arguments)
    threads = max(options.threads)
    torch.set_num_threads(threads)
    for model, engine in entries(options):
        generator = load_generator(model.folder, engine, threads)
        print(
            f"\n{label(model, engine, _steps(options, model))}, {options.seconds:g} s where "
            "nothing else is said\n"
        )
        for axis in _axes(options, model, generator):
            print(_report(axis, options), flush=True)


def _steps(options: argparse.Namespace, model: Model) -> int:
    return max(model.steps(options.steps))


def _axes(options: argparse.Namespace, model: Model, generator: MotionPipeline) -> Iterator[Axis]:
    steps, seconds = _steps(options, model), options.seconds
    longest = model.card.frames[1] / generator.representation.fps
    lengths = sorted({min(length, longest) for length in options.lengths})
    counts = model.card.few_step.steps if model.card.few_step else options.counts
    yield Axis("seconds", "second", lengths, lambda x: Generation(generator, 1, x, steps))
    yield Axis(
        "motions",
        "motion",
        options.batches,
        lambda x: Generation(generator, int(x), seconds, steps),
    )
    yield Axis("steps", "step", counts, lambda x: Generation(generator, 1, seconds, int(x)))


def _report(axis: Axis, options: argparse.Namespace) -> str:
    contenders = {f"{value:g}": axis.make(value) for value in axis.values}
    times = take_turns(contenders, options.turns, options.patience)
    taken = [times.whole(name) for name in contenders]
    each = [ms / value for ms, value in zip(taken, axis.values, strict=True)]
    lines = {"ms": taken, f"ms a {axis.unit}": each, "processor": map(times.processor, contenders)}
    rows = [[name, *map(figure, figures)] for name, figures in lines.items()]
    shown = table([axis.name, *contenders], rows)
    return f"{times}\n\n{shown}\n\n{_line(axis, taken)}\n"


def _line(axis: Axis, taken: Sequence[float]) -> str:
    """Says which straight line fits best, every value by its share of the whole."""
    if len(taken) < 2:
        return "One value alone says nothing about growth."
    slope, start = np.polyfit(axis.values, taken, 1, w=1 / np.array(taken))
    return f"{figure(start)} ms, and {figure(slope)} ms for each {axis.unit}."


if __name__ == "__main__":
    main()
