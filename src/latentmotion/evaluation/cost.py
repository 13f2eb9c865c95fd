"""What one motion costs: parameters, FLOPs, seconds.

Steps are all alike, so that their FLOPs are counted of one and of two:

    FLOPs(n) = FLOPs(1) + (n − 1) (FLOPs(2) − FLOPs(1))

A text encoder is counted where it runs on PyTorch; a graph of ONNX Runtime is not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from latentmotion.checkpoint import load_stages
from latentmotion.condition.interface import TextEncoder
from latentmotion.evaluation.metrics.cost import WARM_UP, aits, flops, parameters
from latentmotion.evaluation.subject import Generated
from latentmotion.evaluation.trials import Question
from latentmotion.runtime.eager import torch_pipeline

TIMED = 20
"""Motions that are timed; fewer where a split has fewer."""


@dataclass(frozen=True)
class Cost:
    """What a model costs."""

    parameters: dict[str, int]
    """Learned numbers of each network."""
    gflops: float | None = None
    """Of one motion, with guidance and decoder, two for each multiply-add; null without a
    denoiser."""
    gflops_frames: int | None = None
    """Length of that motion."""
    aits: float | None = None
    """Average seconds per motion, one at a time."""
    timed: int = 0
    """Motions that were timed, after some that were not."""
    engine: str = ""
    """What ran the timed networks."""

    def lines(self) -> list[str]:
        """Says it in words."""
        counts = ", ".join(f"{name} {count:,}" for name, count in self.parameters.items())
        found = [f"parameters: {counts}"]
        if self.gflops is not None:
            found.append(f"FLOPs: {self.gflops:.2f} G for {self.gflops_frames} frames")
        if self.aits is not None:
            about = f"{self.timed} motions one at a time, {self.engine}"
            found.append(f"AITS: {self.aits:.4f} s ({about})")
        return found


def cost_of(
    folder: Path,
    subject: Generated | None,
    questions: Sequence[Question],
    encoder: TextEncoder | None = None,
) -> Cost:
    """Measures a model.

    Args:
        folder: Its folder.
        subject: It, ready to generate; none for a VAE alone.
        questions: What it is asked while it is timed, one at a time; FLOPs are those of the
            longest.
        encoder: Text encoder, where it is not in the folder.
    """
    counts = parameter_counts(folder)
    if subject is None:
        return Cost(counts)
    longest = longest_of(questions)
    eager = replace(subject, generator=torch_pipeline(folder, encoder))
    return Cost(
        counts,
        generation_flops(eager, longest) / 1e9,
        longest.frames,
        aits([_action(subject, question) for question in questions]),
        len(questions),
        f"after {min(WARM_UP, len(questions))} that warm up",
    )


def parameter_counts(folder: Path) -> dict[str, int]:
    """Returns the learned numbers of each network of a model folder."""
    networks = load_stages(folder).networks
    counts = {name: parameters(part) for name, part in networks.items()}
    return counts | {"together": sum(counts.values())}


def generation_flops(subject: Generated, question: Question) -> int:
    """Returns the floating-point operations of one motion, of a subject on PyTorch."""
    sampling = subject.sampling or subject.card.sampling
    first, second = (
        flops(_action(replace(subject, sampling=sampling.but(steps=n)), question)) for n in (1, 2)
    )
    return first + (sampling.steps - 1) * (second - first)


def _action(subject: Generated, question: Question) -> Callable[[], object]:
    return lambda: subject.answer([question], [0])


def longest_of(questions: Sequence[Question]) -> Question:
    """Returns the question for the longest motion."""
    return max(questions, key=lambda question: question.frames)


def some_of(questions: Sequence[Question]) -> list[Question]:
    """Returns the longest question and others from all over, so many as are timed."""
    stride = max(len(questions) // TIMED, 1)
    return [longest_of(questions), *questions[::stride][: TIMED - 1]]
