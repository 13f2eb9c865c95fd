"""How long it takes to make a file of a motion that is there: clean-up, then each format.

    python -m benchmarks.generation.files

Together with a row of `speed.py` it is the way from a sentence to a file. Every file is of another
motion, so that rotations are found and the mannequin is made each time.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path

import torch

from benchmarks.generation.ours import Model
from benchmarks.harness.contest import figure, table, take_turns, whole
from latentmotion import Motion, MotionPipeline

ENDINGS = (".npz", ".csv", ".bvh", ".glb", ".html")
PROMPTS = (
    *("a person walks forward and kicks", "a person sits down", "a person raises both arms"),
    *("a person runs in a circle", "a person waves", "a person bends down", "a person dances"),
)


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
    seeds = zip(cycle(PROMPTS), range(turns + 8))
    motions = [generate.batch([prompt], seconds, [seed])[0] for prompt, seed in seeds]
    cleaned = [motion.cleaned() for motion in motions]
    with tempfile.TemporaryDirectory() as folder:
        contenders = {"clean-up": whole(motions[0].cleaned)}
        for ending in ENDINGS:
            path = Path(folder) / f"motion{ending}"
            contenders[ending] = whole(partial(_save, cycle(cleaned), path))
        times = take_turns(contenders, turns)
    rows = [
        [name, figure(times.whole(name)), figure(times.processor(name))] for name in times.turns
    ]
    return f"{times}\n\n{table(['a motion that is there', 'ms', 'processor'], rows)}"


def _save(motions: Iterator[Motion], path: Path) -> None:
    replace(next(motions)).save(path)  # without the rotations that the other one knows


if __name__ == "__main__":
    main()
