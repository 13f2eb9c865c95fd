"""Traffic: the bytes that matrix products and convolutions must move, for a roofline.

Every product reads its operands once and writes its result once; what stands between products is
taken to be fused into them. A floor: caches that are too small, and operations of their own, only
add to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils.flop_counter import flop_registry

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
