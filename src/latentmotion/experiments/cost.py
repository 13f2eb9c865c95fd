"""What one motion costs by sampling steps: learned numbers, FLOPs and seconds, one at a time.

Where a split takes `evaluation/cost.py` many motions, a sweep over steps makes a few of one length,
so that a row of 1000 steps on raw frames can be timed too.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from latentmotion.evaluation.cost import parameter_counts
from latentmotion.evaluation.metrics.aits import aits
from latentmotion.evaluation.metrics.flops import flops
from latentmotion.evaluation.report import Figure
from latentmotion.evaluation.subject import Generated

TIMES = 3
"""Motions that are timed, after one that is not."""

SENTENCE = "a person walks forward and then turns around"


def cost_of(subject: Generated, folder: Path, longest: int | None) -> dict[str, Figure]:
    """Measures a generator on PyTorch.

    Args:
        subject: The model and how it is sampled.
        folder: Its model folder.
        longest: Length of the motion in frames; by default the model's longest.
    """
    card = subject.card
    frames = min(longest or card.frames[1], card.frames[1])
    prompts = {"text": SENTENCE, "action": card.condition.get("labels", [""])[0]}

    def one(steps: int) -> Callable[[], object]:
        words, generator = prompts.get(card.task, ""), subject.generator
        options = steps, subject.guidance, subject.sampler
        return lambda: generator.features([words], [frames], [0], *options)

    steps = subject.steps or card.steps
    first, second = flops(one(1)), flops(one(2))
    return {
        "AITS": Figure(aits([one(steps)] * TIMES, warm_up=1)),
        "GFLOPs": Figure((first + (steps - 1) * (second - first)) / 1e9),
        "Parameters": Figure(parameter_counts(folder)["together"] / 1e6),
    }
