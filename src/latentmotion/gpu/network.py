"""Network sessions: a PyTorch network on a device, in a precision, compiled if requested.

In bfloat16, matrix products, convolutions and the activations computed from them alone have 16-bit
inputs and outputs; everything else, and the output of the session, is float32.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
import torch
from torch import Tensor, nn

from latentmotion.engine.options import ExecutionOptions
from latentmotion.engine.session import Session
from latentmotion.gpu.device import GPU, device_named

COMPILER = "inductor"
"""The backend of torch.compile."""

_PRODUCTS = nn.Linear, nn.Conv1d


def network_session(
    network: nn.Module, forward: Callable[..., Tensor], execution: ExecutionOptions
) -> Session:
    """Returns a session with float32 output: an array for arrays, a tensor for tensors.

    Args:
        network: The network that has the weights; it is moved to the device and frozen.
        forward: A function of tensors by name that calls the network.
        execution: Device, precision and launch mode.

    Raises:
        InputError: There is no such device here.
    """
    device = device_named(execution.device)
    network.eval().requires_grad_(False).to(device)
    if execution.precision == "bfloat16":
        for module in network.modules():
            if isinstance(module, _PRODUCTS):
                module.to(torch.bfloat16)
    if execution.launch == "compiled":
        forward = torch.compile(forward, backend=COMPILER)

    @torch.no_grad()
    def run(**inputs: np.ndarray | Tensor) -> np.ndarray | Tensor:
        tensors = {
            name: torch.tensor(value, device=device) if isinstance(value, np.ndarray) else value
            for name, value in inputs.items()
        }
        with arithmetic(execution):
            output = forward(**tensors).float()
        on_host = any(isinstance(value, np.ndarray) for value in inputs.values())
        return output.cpu().numpy() if on_host else output

    return run  # type: ignore[return-value]


def arithmetic(execution: ExecutionOptions) -> ExitStack:
    """Sets the precision of products inside a `with`: bfloat16, or float32 to the last bit."""
    device, halved = execution.device_type, execution.precision == "bfloat16"
    stack = ExitStack()
    stack.enter_context(torch.autocast(device, torch.bfloat16, halved, cache_enabled=False))
    if device == GPU:
        # Left alone, convolutions on a GPU drop 13 bits of their float32 inputs.
        stack.enter_context(torch.backends.cudnn.flags(enabled=True, allow_tf32=False))
    return stack
