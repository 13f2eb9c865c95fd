"""Cost: AITS, FLOPs, parameters, of one motion.

AITS: average inference time per sentence, in seconds.

The time from a sentence (label, nothing) to features in their own units: condition, all sampling
steps with guidance, decoder; one motion at a time. Loading, joints and files are not in it. MLD,
section 4.4. The authors' timer does not wait for the GPU (mld.md §11); this one does, and what runs
for the first time is not timed.

FLOPs: the floating-point operations of networks, two for each multiply-add.

`flops` is exact for matrix products, attention's included, and convolutions, as PyTorch's counter
has them. The paper's "FLOPs" are THOP's (mld.md §11), which counts nothing inside attention.

All steps cost the same, so that FLOPs are counted for one step and for two:

    FLOPs(n) = FLOPs(1) + (n − 1) (FLOPs(2) − FLOPs(1))

A text encoder is counted if it runs on PyTorch; a graph of ONNX Runtime is not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

import torch
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.utils.flop_counter import FlopCounterMode

from latentmotion.diffusion.condition import TextEncoder
from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.protocol import TestPrompt
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import load_stages

WARM_UP = 3  # Motions that are made before the timing.


def aits(
    actions: Sequence[Callable[[], object]],
    warm_up: int = WARM_UP,
    clock: Callable[[], float] | None = None,
) -> float:
    """Returns the mean time of actions, each of which makes one motion.

    Args:
        actions: Each makes one motion.
        warm_up: Number of first actions that are run once before.
        clock: What tells the time, seconds, such as `time.process_time` on a busy machine without a
            GPU; by default that on the wall.
    """
    clock = clock or time.perf_counter
    for action in actions[:warm_up]:
        action()
    seconds = []
    for action in actions:
        _wait()
        start = clock()
        action()
        _wait()
        seconds.append(clock() - start)
    return fmean(seconds)


def _wait() -> None:
    if torch.cuda.is_available():
        torch.cuda.synchronize()


def flops(action: Callable[[], object]) -> int:
    """Returns the floating-point operations of whatever networks an action runs on PyTorch."""
    with sdpa_kernel(SDPBackend.MATH), FlopCounterMode(display=False) as counter:
        action()
    return counter.get_total_flops()


def parameters(network: torch.nn.Module) -> int:
    """Returns the number of parameters; buffers, which are not learned, do not count."""
    return sum(parameter.numel() for parameter in network.parameters())


TIMED = 20  # Motions that are timed; fewer if a split has fewer.


@dataclass(frozen=True)
class Cost:
    """Cost of a model."""

    parameters: dict[str, int]  # Learned numbers of each network.
    # 10⁹ FLOPs of one motion, with guidance and decoder; null without a denoiser.
    gflops: float | None = None
    gflops_frames: int | None = None  # Length of that motion.
    aits: float | None = None  # Average seconds per motion, one at a time.
    timed: int = 0  # Motions that were timed.
    engine: str = ""  # Description of the warm-up.

    def lines(self) -> list[str]:
        """Returns the cost in words."""
        counts = ", ".join(f"{name} {count:,}" for name, count in self.parameters.items())
        lines = [f"parameters: {counts}"]
        if self.gflops is not None:
            lines.append(f"FLOPs: {self.gflops:.2f} G for {self.gflops_frames} frames")
        if self.aits is not None:
            conditions = f"{self.timed} motions one at a time, {self.engine}"
            lines.append(f"AITS: {self.aits:.4f} s ({conditions})")
        return lines


def cost_of(
    folder: Path,
    candidate: Generated | None,
    prompts: Sequence[TestPrompt],
    encoder: TextEncoder | None = None,
    clock: Callable[[], float] | None = None,
) -> Cost:
    """Measures a model.

    Args:
        folder: Its folder.
        candidate: The model, ready to generate; None for a VAE alone.
        prompts: Prompts of the timed motions, one at a time; FLOPs are those of the longest.
        encoder: Text encoder, if it is not in the folder.
        clock: As for `aits`.
    """
    counts = {name: parameters(network) for name, network in load_stages(folder).networks.items()}
    counts["together"] = sum(counts.values())
    if candidate is None:
        return Cost(counts)
    longest = longest_of(prompts)
    eager = replace(candidate, generator=torch_pipeline(folder, encoder))
    return Cost(
        counts,
        generation_flops(eager, longest) / 1e9,
        longest.frames,
        aits([_generation(candidate, prompt) for prompt in prompts], clock=clock),
        len(prompts),
        f"after {min(WARM_UP, len(prompts))} that warm up",
    )


def generation_flops(candidate: Generated, prompt: TestPrompt) -> int:
    """Returns the floating-point operations of one motion, of a candidate on PyTorch."""
    sampling = candidate.sampling or candidate.card.sampling
    first, second = (
        flops(_generation(replace(candidate, sampling=sampling.but(steps=n)), prompt))
        for n in (1, 2)
    )
    return first + (sampling.steps - 1) * (second - first)


def _generation(candidate: Generated, prompt: TestPrompt) -> Callable[[], object]:
    return lambda: candidate.generate([prompt], [0])


def longest_of(prompts: Sequence[TestPrompt]) -> TestPrompt:
    """Returns the prompt of the longest motion."""
    return max(prompts, key=lambda prompt: prompt.frames)


def timed_prompts(prompts: Sequence[TestPrompt]) -> list[TestPrompt]:
    """Returns the longest prompt and others spread over the set, `TIMED` at most, each once."""
    stride, longest = max(len(prompts) // TIMED, 1), longest_of(prompts)
    return [longest, *(prompt for prompt in prompts[::stride] if prompt is not longest)][:TIMED]
