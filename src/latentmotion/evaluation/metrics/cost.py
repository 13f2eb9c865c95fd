"""Cost: AITS, FLOPs, parameters, bytes moved.

AITS: average inference time per sentence, in seconds.

The time from a sentence (label, nothing) to features in their own units: condition, all sampling
steps with guidance, decoder; one motion at a time. Loading, joints and files are not in it. MLD,
section 4.4. The authors' timer does not wait for the GPU (spec 11.5); this one does, and what runs
for the first time is not timed.

FLOPs: the floating-point operations of networks, two for each multiply-add.

`flops` is exact for matrix products, attention's included, and convolutions, as PyTorch's counter
has them. `thop_macs` counts as the paper does, by THOP (spec 11.5): linear layers, norms and
convolutions outside attention, nothing inside; "FLOPs" of the paper are twice these, for a motion
of 40 frames, CLIP on two prompts included.

How many numbers a network has learned.

Traffic: the bytes that matrix products and convolutions must move, for a roofline.

Every product reads its operands once and writes its result once; what stands between products is
taken to be fused into them. A floor: caches that are too small, and operations of their own, only
add to it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import FlopCounterMode, flop_registry

from latentmotion.nn.attention import CrossAttention, SelfAttention

WARM_UP = 3
"""Motions that are made before the clock starts."""


def aits(actions: Sequence[Callable[[], object]], warm_up: int = WARM_UP) -> float:
    """Returns the mean time of actions, each of which makes one motion.

    Args:
        actions: What is timed.
        warm_up: How many of them, from the first, are run once before.
    """
    for action in actions[:warm_up]:
        action()
    return fmean([_seconds(action) for action in actions])


def _seconds(action: Callable[[], object]) -> float:
    _wait()
    start = time.perf_counter()
    action()
    _wait()
    return time.perf_counter() - start


def _wait() -> None:
    if torch.cuda.is_available():
        torch.cuda.synchronize()


THOP_NORM = 4
"""Operations that THOP counts for a number that a norm with weights returns."""

_UNSEEN = (SelfAttention, CrossAttention)
"""What stands where the authors have `nn.MultiheadAttention`, which THOP does not know."""


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
        total += _thop_of(module, output)

    with ExitStack() as stack:
        for module in _seen(network):
            stack.callback(module.register_forward_hook(count).remove)
        with torch.no_grad():
            action()
    return total


def _thop_of(module: nn.Module, output: Tensor) -> int:
    if isinstance(module, nn.Linear):
        return output.numel() * module.in_features
    if isinstance(module, nn.Conv1d):
        return output.numel() * module.in_channels // module.groups * module.kernel_size[0]
    return output.numel() * THOP_NORM


def _seen(network: nn.Module) -> Iterator[nn.Module]:
    if isinstance(network, (nn.Linear, nn.LayerNorm, nn.Conv1d)):
        yield network
    for child in network.children():
        if not isinstance(child, _UNSEEN):
            yield from _seen(child)


def parameters(network: nn.Module) -> int:
    """Returns the number of parameters; buffers, which are not learned, do not count."""
    return sum(parameter.numel() for parameter in network.parameters())


_ATTENTION = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu
"""The one product of ours that PyTorch's counter of FLOPs does not know."""


@dataclass(frozen=True)
class Traffic:
    """Bytes that are read or written."""

    weights: int
    """Of learned numbers."""
    activations: int
    """Of all else."""

    @property
    def total(self) -> int:
        """Both."""
        return self.weights + self.activations


def traffic(network: nn.Module, action: Callable[[], object]) -> Traffic:
    """Returns the bytes that a network's products move while an action runs."""
    with _Counter(network) as counter, torch.no_grad():
        action()
    return Traffic(counter.weights, counter.activations)


class _Counter(TorchDispatchMode):
    """Looks at every operation, and counts the products' operands and results."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.weights = self.activations = 0
        self._learned = {_place(parameter) for parameter in network.parameters()}

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
                self._count(tensor)
        return output

    def _count(self, tensor: Tensor) -> None:
        size = tensor.numel() * tensor.element_size()
        if _place(tensor) in self._learned:
            self.weights += size
        else:
            self.activations += size


def _tensors(values: Iterable[Any]) -> list[Tensor]:
    return [value for value in values if isinstance(value, Tensor)]


def _place(tensor: Tensor) -> int:
    return tensor.untyped_storage().data_ptr()
