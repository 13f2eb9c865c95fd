"""FLOPs: the floating-point operations of networks, two for each multiply-add.

`flops` is exact for matrix products, attention's included, and convolutions, as PyTorch's counter
has them. `thop_macs` counts as the paper does, by THOP (mld.md §11): linear layers, norms and
convolutions outside attention, nothing inside; "FLOPs" of the paper are twice these, for a motion
of 40 frames, CLIP on two prompts included.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import torch
from torch import Tensor, nn
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.utils.flop_counter import FlopCounterMode

from latentmotion.nn.attention import CrossAttention, SelfAttention

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
