"""CUDA graphs: functions of tensors, recorded once per shape and replayed from then on.

A recording replays thousands of kernels with one launch, so a GPU never waits for Python.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any

import torch
from torch import Tensor

Function = Callable[..., Tensor]
"""Tensors of one device to a tensor, without reading the host's memory."""

MAX_RECORDINGS = 32
"""Maximum number of recordings kept; the one unused for longest is dropped."""
WARM_UP = 3
"""Runs before a recording, in which libraries choose their kernels."""

_ONE_AT_A_TIME = Lock()  # a process may make only one recording at a time, for any model


class Recording:
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


class Recorder:
    """Records each function once for each shape of its inputs, and replays it from then on.

    Args:
        record: Makes a recording of a function and inputs, e.g. `on_gpu`.
        most: Maximum number of recordings kept.
    """

    def __init__(
        self,
        record: Callable[[Function, tuple[Tensor, ...]], Function],
        most: int = MAX_RECORDINGS,
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
    return lambda function, inputs: Recording(function, inputs, pool, stream)
