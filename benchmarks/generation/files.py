"""How long it takes to make a file of a motion that is there: clean-up, then each format.

    python -m benchmarks.generation.files

Together with a row of `speed.py` it is the way from a sentence to a file.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import torch

from benchmarks.generation.ours import Model
from benchmarks.harness.contest import figure, table, take_turns, whole
from latentmotion import MotionPipeline

ENDINGS = (".npz", ".csv", ".bvh", ".glb", ".html")


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", type=Model.of, default="starter")
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--turns", type=int, default=10)
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    print(report(options.model, options.seconds, options.turns))


def report(model: Model, seconds: float, turns: int) -> str:
    """Returns the table.

    Args:
        model: Whose motion it is.
        seconds: The motion's length.
        turns: Turns that count.
    """
    generate = MotionPipeline.from_pretrained(model.folder, "onnxruntime", threads=1)
    motion = generate("a person walks forward and kicks", seconds)
    cleaned = motion.cleaned()
    with tempfile.TemporaryDirectory() as folder:
        contenders = {"clean-up": whole(motion.cleaned)}
        for ending in ENDINGS:
            contenders[ending] = whole(partial(cleaned.save, Path(folder) / f"motion{ending}"))
        times = take_turns(contenders, turns)
    rows = [
        [name, figure(times.whole(name)), figure(times.processor(name))] for name in times.turns
    ]
    return f"{times}\n\n{table(['a motion that is there', 'ms', 'processor'], rows)}"


if __name__ == "__main__":
    main()
