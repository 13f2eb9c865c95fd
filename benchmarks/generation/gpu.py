"""What a GPU makes of a model: latency and throughput by way of launching, memory, rooflines.

    PYTHONPATH=src python -m benchmarks.generation.gpu starter fast -o results
    PYTHONPATH=src python -m benchmarks.generation.gpu starter --device cpu --quick -o /tmp/results

Every way (eager, CUDA graphs, compiled; float32, bfloat16) is first compared with the CPU in
float32. Latencies are of one sentence, text to joints, which are copied to the host. Every result
is written as soon as it is there: results.json for programs, results.md to read. `--training` has
the steps of both training stages in place of generation.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
import torch

from benchmarks.generation.roofline import ordered, report
from benchmarks.harness.contest import figure, table
from benchmarks.training.device import training_rows
from latentmotion.diffusion.condition import Conditioning
from latentmotion.engine.backend import ExecutionOptions
from latentmotion.engine.request import GenerationRequest
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.device import describe_machine
from latentmotion.pipeline import MotionPipeline

STEPS = 50, 10, 4, 2, 1
BATCHES = 1, 4, 16, 64, 256, 512, 1024
WAYS = ("eager", "float32"), ("eager", "bfloat16"), ("graph", "bfloat16"), ("compiled", "bfloat16")
SECONDS = 4.0


class Results:
    """Tables that are on disk as soon as they have a line.

    Args:
        folder: Where they go.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._texts: list[str] = []
        self._rows: dict[str, list[dict[str, object]]] = {}

    def add(self, name: str, row: dict[str, object]) -> None:
        """Adds a line to a table."""
        print(f"{name}: {row}", flush=True)
        self._rows.setdefault(name, []).append(row)
        self._write()

    def say(self, text: str) -> None:
        """Adds a paragraph, or a table that is text already."""
        print(text, flush=True)
        self._texts.append(text)
        self._write()

    def _write(self) -> None:
        whole = {"machine": _machine(), "texts": self._texts, "tables": self._rows}
        (self._folder / "results.json").write_text(json.dumps(whole, indent=1))
        tables = [f"## {name}\n\n{_table(rows)}" for name, rows in self._rows.items()]
        pages = [f"# {_machine()}", *self._texts, *tables]
        (self._folder / "results.md").write_text("\n\n".join(pages) + "\n")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures, and goes on with the next where one fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("models", nargs="*", default=["starter"])
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--quick", action="store_true", help="few sizes and turns, to try it out")
    parser.add_argument("--training", action="store_true")
    default = Path(os.environ.get("OUT", "results"))
    parser.add_argument("-o", "--output", type=Path, default=default)
    options = parser.parse_args(arguments)
    results = Results(options.output)
    if options.training:
        for name, row in training_rows(options.device, options.quick):
            results.add(name, row)
        return
    for model in options.models:
        for measure in (_agreement, _latency, _throughput, _roofline):
            _tried(results, measure, model, options)


def _tried(results: Results, measure: Callable[..., None], *given: object) -> None:
    # A lent machine goes back soon: what fails is written down, and the rest is measured.
    try:
        measure(results, *given)
    except Exception:
        results.say(f"{measure.__name__} of {given[0]} failed:\n\n```\n{traceback.format_exc()}```")


def _agreement(results: Results, model: str, options: argparse.Namespace) -> None:
    expected = torch_pipeline(model)
    steps = _steps_of(expected, options.quick)[0]
    prompts, frames, seeds = ["a person walks forward", "a person jumps"], [80, 63], [1, 2]
    wanted = expected.features(prompts, frames, seeds, steps)
    std = np.array(expected.card.normalizer_std)
    for execution in _ways(options):
        found = torch_pipeline(model, execution=execution).features(prompts, frames, seeds, steps)
        error = [((a - b) / std) ** 2 for a, b in zip(found, wanted, strict=True)]
        rms = float(np.sqrt(np.concatenate(error).mean()))
        row = {"model": model, "way": str(execution), "steps": steps, "rms of normalized": rms}
        results.add("Agreement with the CPU in float32", row)


def _latency(results: Results, model: str, options: argparse.Namespace) -> None:
    for execution in _ways(options):
        generator = torch_pipeline(model, execution=execution)
        for steps in _steps_of(generator, options.quick):
            order = ordered(generator, 1, SECONDS, steps)
            text = _milliseconds(partial(generator.condition, order.prompts), options)
            walk = partial(_walk, generator, generator.condition(order.prompts), order)
            start = time.perf_counter()
            walk()
            first, chain = time.perf_counter() - start, _milliseconds(walk, options)
            row = {"model": model, "way": str(execution), "steps": steps, "first, s": first}
            row |= {"text, ms": text, "to joints, ms": chain, "whole, ms": text + chain}
            results.add("Latency of one motion of 4 s, text included", row)


def _throughput(results: Results, model: str, options: argparse.Namespace) -> None:
    for execution in _ways(options):
        generator = torch_pipeline(model, execution=execution)
        for steps in {generator.card.sampling.steps, min(_steps_of(generator, options.quick))}:
            for batch in (1, 4) if options.quick else BATCHES:
                row = {"model": model, "way": str(execution), "steps": steps, "batch": batch}
                row |= _pace(generator, batch, steps, options)
                results.add("Throughput, words to joints on the host", row)


def _pace(
    generator: MotionPipeline, batch: int, steps: int, options: argparse.Namespace
) -> dict[str, object]:
    if options.device != "cpu":
        torch.cuda.reset_peak_memory_stats()
    order = ordered(generator, batch, SECONDS, steps)
    # The sentence is read once: its encoder runs on the CPU, beside the device.
    one = generator.condition(order.prompts[:1])
    words = Conditioning(one.tokens.repeat(batch, 0), one.mask.repeat(batch, 0))
    elapsed = _milliseconds(partial(_walk, generator, words, order), options)
    memory = torch.cuda.max_memory_allocated() / 1e6 if options.device != "cpu" else 0.0
    return {"ms": elapsed, "motions/s": 1e3 * batch / elapsed, "peak memory, MB": memory}


def _walk(generator: MotionPipeline, words: Conditioning, order: GenerationRequest) -> np.ndarray:
    return generator.joints_of(generator.generate_batch(order, words)).cpu().numpy()


def _roofline(results: Results, model: str, options: argparse.Namespace) -> None:
    for execution in _ways(options):
        if execution.launch != "compiled":
            results.say(report(model, (1, 4) if options.quick else (1, 256), None, 4.0, execution))


def _ways(options: argparse.Namespace) -> Iterator[ExecutionOptions]:
    for launch, precision in WAYS:
        if options.device != "cpu" or launch == "eager":
            yield ExecutionOptions(options.device, precision, launch)


def _steps_of(generator: MotionPipeline, quick: bool) -> Sequence[int]:
    few_step = generator.card.few_step
    known = sorted(few_step.steps, reverse=True) if few_step else STEPS
    return known[-2:] if quick else known


def _milliseconds(action: Callable[[], object], options: argparse.Namespace) -> float:
    """Median of many, or of as many as two seconds hold; what they return lies on the host."""
    for _ in range(1 if options.quick else 3):
        action()
    times: list[float] = []
    end = time.perf_counter() + (0.2 if options.quick else 2.0)
    while len(times) < 3 or (time.perf_counter() < end and len(times) < 200):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return 1e3 * median(times)


def _table(rows: Sequence[dict[str, object]]) -> str:
    cells = [
        [figure(value) if isinstance(value, float) else str(value) for value in row.values()]
        for row in rows
    ]
    return table(list(rows[0]), cells)


def _machine() -> str:
    card = torch.cuda.get_device_name() if torch.cuda.is_available() else "no GPU"
    return f"{card}; {describe_machine()}; CUDA {torch.version.cuda}"


if __name__ == "__main__":
    main()
