"""A PyTorch network as a session: on its device, in its precision, compiled where asked.

In bfloat16 matrix products and convolutions read and give numbers of 16 bits, and so does what is
computed from these alone, as activations; all else, and the answer, is float32.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
import torch
from torch import Tensor, nn

from latentmotion.runtime.computing import Computing
from latentmotion.runtime.device import device_named
from latentmotion.runtime.session import Session

COMPILER = "inductor"
"""The backend of torch.compile."""

_PRODUCTS = nn.Linear, nn.Conv1d


def network_session(
    network: nn.Module, forward: Callable[..., Tensor], computing: Computing
) -> Session:
    """Returns a session that answers in float32, arrays with an array and tensors with a tensor.

    Args:
        network: What has the weights; it is moved, and will train no more.
        forward: A function of tensors by name that calls it.
        computing: Where and how.

    Raises:
        InputError: The device is not here.
    """
    place = device_named(computing.device)
    network.eval().requires_grad_(False).to(place)
    if computing.precision == "bfloat16":
        _halve(network)
    if computing.launch == "compiled":
        forward = torch.compile(forward, backend=COMPILER)

    @torch.no_grad()
    def run(**inputs: np.ndarray | Tensor) -> np.ndarray | Tensor:
        tensors = {name: _tensor(given, place) for name, given in inputs.items()}
        with arithmetic(computing):
            answer = forward(**tensors).float()
        on_host = any(isinstance(given, np.ndarray) for given in inputs.values())
        return answer.cpu().numpy() if on_host else answer

    return run  # type: ignore[return-value]


def arithmetic(computing: Computing) -> ExitStack:
    """The precision of products inside a `with`: bfloat16, or float32 to the last bit."""
    device, halved = computing.device.partition(":")[0], computing.precision == "bfloat16"
    stack = ExitStack()
    stack.enter_context(torch.autocast(device, torch.bfloat16, halved, cache_enabled=False))
    if computing.on_gpu:
        # Left alone, convolutions there drop 13 bits of their float32 inputs.
        stack.enter_context(torch.backends.cudnn.flags(enabled=True, allow_tf32=False))
    return stack


def _halve(network: nn.Module) -> None:
    for module in network.modules():
        if isinstance(module, _PRODUCTS):
            module.to(torch.bfloat16)


def _tensor(given: np.ndarray | Tensor, place: torch.device) -> Tensor:
    return given if isinstance(given, Tensor) else torch.tensor(given, device=place)
