"""Compares settings of a model on motions it has not seen: quality against steps and guidance.

python examples/evaluate.py starter PREPARED_FOLDER

Feature metrics (FID, R-precision) need an evaluator in place of None: see docs/guide/evaluators.md.
"""

from __future__ import annotations

import sys
from dataclasses import replace

from latentmotion import Dataset, MotionPipeline
from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.evaluate import compare
from latentmotion.evaluation.protocol import CLEAN

SETTINGS = ((10, 4.0), (50, 4.0), (50, 7.5))  # Sampling steps and guidance.


def main(model: str, folder: str, split: str = "test") -> None:
    """Prints a table with a row for each setting, beside the real motions."""
    generate = MotionPipeline.from_pretrained(model)
    candidates = [
        Generated(
            generate,
            generate.card.sampling.but(steps, guidance),
            row=f"{steps} steps, guidance {guidance:g}",
        )
        for steps, guidance in SETTINGS
    ]
    protocol = replace(CLEAN, split=split, replications=3)
    print(compare(candidates, Dataset.load(folder), None, protocol).markdown())


if __name__ == "__main__":
    main(*sys.argv[1:])
