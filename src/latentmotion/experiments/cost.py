"""What one motion costs: parameters, FLOPs and seconds, batch 1, the text encoder's FLOPs left out.

    FLOPs(steps) = FLOPs(1) + (steps - 1) (FLOPs(2) - FLOPs(1))

A multiply-add is two FLOPs; attention is counted, as THOP, which the paper uses, does not.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from torch.utils.flop_counter import FlopCounterMode

from latentmotion.checkpoint import load_model
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
    frames = min(longest or subject.card.frames[1], subject.card.frames[1])
    prompt = {"text": SENTENCE, "action": subject.card.condition.get("labels", [""])[0]}

    def one(chosen: Generated) -> Callable[[], object]:
        words = prompt.get(chosen.card.task, "")
        options = chosen.steps, chosen.guidance, chosen.sampler
        return lambda: chosen.generator.features([words], [frames], [0], *options)

    steps = subject.steps or subject.card.steps
    first, second = (flops(one(replace(subject, steps=n))) for n in (1, 2))
    return {
        "Seconds": Figure(seconds(one(subject))),
        "GFLOPs": Figure((first + (steps - 1) * (second - first)) / 1e9),
        "Parameters": Figure(parameters(folder) / 1e6),
    }


def seconds(action: Callable[[], object]) -> float:
    """Returns the median time of an action that is warm."""
    action()
    taken = []
    for _ in range(TIMES):
        start = time.perf_counter()
        action()
        taken.append(time.perf_counter() - start)
    return sorted(taken)[TIMES // 2]


def flops(action: Callable[[], object]) -> int:
    """Returns the floating-point operations of an action's networks."""
    with FlopCounterMode(display=False) as counter:
        action()
    return counter.get_total_flops()


def parameters(folder: Path) -> int:
    """Returns the numbers that were learned, of both stages."""
    model = load_model(folder)
    networks = [network for network in (model.vae, model.denoiser) if network is not None]
    return sum(weight.numel() for network in networks for weight in network.parameters())
