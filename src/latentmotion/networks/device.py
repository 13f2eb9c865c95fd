"""Devices of PyTorch, networks on them, and functions recorded there as CUDA graphs.

In bfloat16, matrix products, convolutions and the activations computed from them alone have 16-bit
inputs and outputs; everything else, and the output of the session, is float32.

A recording replays thousands of kernels with one launch, so a GPU never waits for Python.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import ExitStack
from functools import cache
from threading import Lock
from typing import Any

import numpy as np
import torch
import torch.distributed
from torch import Tensor, nn

from latentmotion.engine.backend import ExecutionOptions
from latentmotion.engine.session import Session
from latentmotion.errors import InputError
from latentmotion.storage.provenance import processor, processor_flags

GPU = torch.cuda.__name__.rpartition(".")[2]  # PyTorch's name for the type of NVIDIA's GPUs.


def default_device() -> str:
    """Returns the name of the GPU, if there is one, else of the CPU."""
    return GPU if torch.cuda.is_available() else "cpu"


def device_named(name: str) -> torch.device:
    """Returns a device after checking that it works.

    Raises:
        InputError: There is no such device here.
    """
    try:
        torch.empty(0, device=name)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"no device {name!r} here: {error}; try --device cpu") from error
    return torch.device(name)


def autocast(device: torch.device, precision: str = "auto") -> torch.autocast:
    """Returns the context in which networks compute in a precision.

    Args:
        device: Device of the networks.
        precision: `float32`, `bfloat16`, or `auto` for bfloat16 where the device multiplies it.
    """
    halved = precision == "bfloat16" or (precision == "auto" and has_bfloat16(device.type))
    return torch.autocast(device.type, torch.bfloat16, halved)


@cache
def has_bfloat16(kind: str) -> bool:
    """Returns whether a kind of device multiplies bfloat16; others take four times as long."""
    if kind == GPU:
        return torch.cuda.get_device_capability() >= (8, 0)
    return kind == "cpu" and bool({"avx512_bf16", "amx_bf16", "bf16"} & processor_flags())


def describe_machine() -> str:
    """Returns processor, processes with their threads, devices and PyTorch's version."""
    world = torch.distributed.get_world_size() if torch.distributed.is_initialized() else 1
    parts = [processor(), f"{world} processes of {torch.get_num_threads()} threads"]
    if torch.cuda.is_available():
        parts.append(f"{torch.cuda.device_count()} x {torch.cuda.get_device_name()}")
    return ", ".join([*parts, f"PyTorch {torch.__version__}"])


COMPILER = "inductor"  # The backend of torch.compile.

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


# Tensors of one device to a tensor, without reading the host's memory.
Function = Callable[..., Tensor]

MAX_RECORDINGS = 32  # Maximum number of recordings kept; the one unused for longest is dropped.
WARM_UP = 3  # Runs before a recording, in which libraries choose their kernels.

_ONE_AT_A_TIME = Lock()  # a process may make only one recording at a time, for any model


class RecordedFunction:
    """A function on a GPU, recorded for inputs of these shapes.

    Args:
        function: The function to record; kept, since a replay reads its constants in place.
        inputs: Inputs of the shapes; their values do not matter.
        pool: Memory that recordings share, since no two of them run at once.
        stream: The stream of the recording, on the device of the inputs.
    """

    def __init__(
        self, function: Function, inputs: tuple[Tensor, ...], pool: Any, stream: torch.cuda.Stream
    ) -> None:
        self._function = function
        self._inputs = [tensor.clone() for tensor in inputs]
        # PyTorch's current device may be another one, where a recording would stay empty.
        with torch.cuda.device(stream.device):
            stream.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(stream):
                for _ in range(WARM_UP):
                    function(*self._inputs)
            torch.cuda.current_stream().wait_stream(stream)
            self._graph = torch.cuda.CUDAGraph()
            # Meanwhile other threads may allocate and copy, which the mode "global" forbids.
            with torch.cuda.graph(self._graph, pool, stream, "thread_local"):
                self._output = function(*self._inputs)

    def __call__(self, *inputs: Tensor) -> Tensor:
        """Replays the function on other inputs of the same shapes."""
        for recorded, tensor in zip(self._inputs, inputs, strict=True):
            recorded.copy_(tensor)
        self._graph.replay()
        return self._output.clone()


class FunctionRecorder:
    """Records each function once for each shape of its inputs, and replays it from then on.

    Args:
        record: Makes a recording of a function and inputs, e.g. `on_gpu`.
        most: Maximum number of recordings kept.
    """

    def __init__(
        self, record: Callable[[Function, tuple[Tensor, ...]], Function], most: int = MAX_RECORDINGS
    ) -> None:
        self._record = record
        self._most = most
        self._recordings: OrderedDict[Hashable, Function] = OrderedDict()

    def __call__(self, name: Hashable, function: Function, *inputs: Tensor) -> Tensor:
        """Replays the function's recording for these shapes, after making it if there is none."""
        key = name, tuple((tuple(tensor.shape), tensor.dtype) for tensor in inputs)
        with _ONE_AT_A_TIME:
            if key not in self._recordings:
                self._recordings[key] = self._record(function, inputs)
            self._recordings.move_to_end(key)
            if len(self._recordings) > self._most:
                self._recordings.popitem(last=False)
            return self._recordings[key](*inputs)


def on_gpu(device: torch.device) -> Callable[[Function, tuple[Tensor, ...]], Function]:
    """Returns a function that makes recordings on a device; they share their memory."""
    pool, stream = torch.cuda.graph_pool_handle(), torch.cuda.Stream(device)
    return lambda function, inputs: RecordedFunction(function, inputs, pool, stream)
