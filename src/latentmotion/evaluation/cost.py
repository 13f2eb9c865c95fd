"""Cost: AITS, FLOPs, parameters, bytes moved, of one motion.

AITS: average inference time per sentence, in seconds.

The time from a sentence (label, nothing) to features in their own units: condition, all sampling
steps with guidance, decoder; one motion at a time. Loading, joints and files are not in it. MLD,
section 4.4. The authors' timer does not wait for the GPU (mld.md §11); this one does, and what runs
for the first time is not timed.

FLOPs: the floating-point operations of networks, two for each multiply-add.

`flops` is exact for matrix products, attention's included, and convolutions, as PyTorch's counter
has them. `thop_macs` counts as the paper does, by THOP (mld.md §11): linear layers, norms and
convolutions outside attention, nothing inside; "FLOPs" of the paper are twice these, for a motion
of 40 frames, CLIP on two prompts included.

Traffic: the bytes that matrix products and convolutions must move, for a roofline.

Every product reads its operands once and writes its result once; what stands between products is
taken to be fused into them. This is a lower bound: small caches and separate operations add to it.

All steps cost the same, so that FLOPs are counted for one step and for two:

    FLOPs(n) = FLOPs(1) + (n − 1) (FLOPs(2) − FLOPs(1))

A text encoder is counted if it runs on PyTorch; a graph of ONNX Runtime is not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import FlopCounterMode, flop_registry

from latentmotion.condition import TextEncoder
from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.protocol import TestPrompt
from latentmotion.networks.backend import torch_pipeline
from latentmotion.networks.checkpoint import load_stages
from latentmotion.networks.transformer import CrossAttention, SelfAttention

WARM_UP = 3
"""Motions that are made before the timing."""


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


THOP_NORM = 4
"""Operations that THOP counts for a number that a norm with weights returns."""

# Modules in place of the authors' `nn.MultiheadAttention`, which THOP does not know.
_UNKNOWN_TO_THOP = (SelfAttention, CrossAttention)


def flops(action: Callable[[], object]) -> int:
    """Returns the floating-point operations of whatever networks an action runs on PyTorch."""
    with sdpa_kernel(SDPBackend.MATH), FlopCounterMode(display=False) as counter:
        action()
    return counter.get_total_flops()


def thop_macs(network: nn.Module, action: Callable[[], object]) -> int:
    """Returns the multiply-adds that THOP would count of a network while an action runs."""
    total = 0

    def count(module: nn.Module, _: object, output: Tensor) -> None:
        nonlocal total
        if isinstance(module, nn.Linear):
            total += output.numel() * module.in_features
        elif isinstance(module, nn.Conv1d):
            inputs = module.in_channels // module.groups
            total += output.numel() * inputs * module.kernel_size[0]
        else:
            total += output.numel() * THOP_NORM

    with ExitStack() as stack:
        for module in _counted(network):
            stack.callback(module.register_forward_hook(count).remove)
        with torch.no_grad():
            action()
    return total


def _counted(network: nn.Module) -> Iterator[nn.Module]:
    """Yields the modules that THOP counts."""
    if isinstance(network, (nn.Linear, nn.LayerNorm, nn.Conv1d)):
        yield network
    for child in network.children():
        if not isinstance(child, _UNKNOWN_TO_THOP):
            yield from _counted(child)


def parameters(network: nn.Module) -> int:
    """Returns the number of parameters; buffers, which are not learned, do not count."""
    return sum(parameter.numel() for parameter in network.parameters())


# The only product here that PyTorch's counter of FLOPs does not know.
_ATTENTION = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu


@dataclass(frozen=True)
class Traffic:
    """Bytes that are read or written."""

    weights: int
    """Bytes of parameters."""
    activations: int
    """Bytes of everything else."""

    @property
    def total(self) -> int:
        """Bytes of parameters and activations."""
        return self.weights + self.activations


def traffic(network: nn.Module, action: Callable[[], object]) -> Traffic:
    """Returns the bytes that a network's products move while an action runs."""
    with _Counter(network) as counter, torch.no_grad():
        action()
    return Traffic(counter.weights, counter.activations)


class _Counter(TorchDispatchMode):
    """Counts the operands and results of the products among all operations."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.weights = self.activations = 0
        self._learned = {_storage(parameter) for parameter in network.parameters()}

    def __torch_dispatch__(
        self,
        operation: Any,
        types: Any,
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        """Runs an operation and counts it."""
        output = operation(*args, **(kwargs or {}))
        if operation.overloadpacket in flop_registry or operation.overloadpacket is _ATTENTION:
            first = output[:1] if isinstance(output, tuple) else [output]
            for tensor in [*_tensors(args), *_tensors((kwargs or {}).values()), *first]:
                size = tensor.numel() * tensor.element_size()
                if _storage(tensor) in self._learned:
                    self.weights += size
                else:
                    self.activations += size
        return output


def _tensors(values: Iterable[Any]) -> list[Tensor]:
    return [value for value in values if isinstance(value, Tensor)]


def _storage(tensor: Tensor) -> int:
    return tensor.untyped_storage().data_ptr()


TIMED = 20
"""Motions that are timed; fewer if a split has fewer."""


@dataclass(frozen=True)
class Cost:
    """Cost of a model."""

    parameters: dict[str, int]
    """Learned numbers of each network."""
    gflops: float | None = None
    """10⁹ FLOPs of one motion, with guidance and decoder; null without a denoiser."""
    gflops_frames: int | None = None
    """Length of that motion."""
    aits: float | None = None
    """Average seconds per motion, one at a time."""
    timed: int = 0
    """Motions that were timed."""
    engine: str = ""
    """Description of the warm-up."""

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
    counts = parameter_counts(folder)
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


def parameter_counts(folder: Path) -> dict[str, int]:
    """Returns the number of parameters of each network of a model folder."""
    networks = load_stages(folder).networks
    counts = {name: parameters(network) for name, network in networks.items()}
    return counts | {"together": sum(counts.values())}


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
