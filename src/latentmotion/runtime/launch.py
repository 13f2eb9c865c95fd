"""How a function of tensors is run: directly, or as a CUDA graph that was recorded once per shape.

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
"""Tensors of one device to a tensor, without a look at the host's memory."""

MOST = 32
"""Recordings that are kept; the one unused for longest goes."""
WARM_UP = 3
"""Runs before a recording, in which libraries choose their kernels."""

_ONE_AT_A_TIME = Lock()  # a process may make but one recording at once, whichever model's


class Recording:
    """A function on a GPU, recorded for inputs of these shapes.

    Args:
        function: What is recorded; it is kept, as its constants are read where they lay.
        inputs: Inputs of the shapes; their values do not matter.
        pool: Memory that recordings share, since no two of them run at once.
        aside: The stream that they are made on, of the device of the inputs.
    """

    def __init__(
        self, function: Function, inputs: tuple[Tensor, ...], pool: Any, aside: torch.cuda.Stream
    ) -> None:
        self._function = function
        self._inputs = [given.clone() for given in inputs]
        # PyTorch's current device may be another one, where a recording would stay empty.
        with torch.cuda.device(aside.device):
            self._warm_up(aside)
            self._graph = torch.cuda.CUDAGraph()
            # Meanwhile other threads may allocate and copy, which the mode "global" forbids them.
            with torch.cuda.graph(self._graph, pool, aside, "thread_local"):
                self._output = function(*self._inputs)

    def __call__(self, *inputs: Tensor) -> Tensor:
        """Replays it on other inputs of the same shapes."""
        for kept, given in zip(self._inputs, inputs, strict=True):
            kept.copy_(given)
        self._graph.replay()
        return self._output.clone()

    def _warm_up(self, aside: torch.cuda.Stream) -> None:
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):
            for _ in range(WARM_UP):
                self._function(*self._inputs)
        torch.cuda.current_stream().wait_stream(aside)


class Recorder:
    """Records each function once for each shape of its inputs, and replays it from then on.

    Args:
        record: Makes a recording of a function and inputs, e.g. `on_gpu`.
        most: How many are kept.
    """

    def __init__(
        self, record: Callable[[Function, tuple[Tensor, ...]], Function], most: int = MOST
    ) -> None:
        self._record = record
        self._most = most
        self._kept: OrderedDict[Hashable, Function] = OrderedDict()

    def __call__(self, name: Hashable, function: Function, *inputs: Tensor) -> Tensor:
        """Replays the function's recording for these shapes, made where there is none."""
        shapes = tuple((tuple(given.shape), given.dtype) for given in inputs)
        with _ONE_AT_A_TIME:
            return self._recording((name, shapes), function, inputs)(*inputs)

    def _recording(self, key: Hashable, function: Function, inputs: tuple[Tensor, ...]) -> Function:
        if key not in self._kept:
            self._kept[key] = self._record(function, inputs)
        self._kept.move_to_end(key)
        if len(self._kept) > self._most:
            self._kept.popitem(last=False)
        return self._kept[key]


def on_gpu(device: torch.device) -> Callable[[Function, tuple[Tensor, ...]], Function]:
    """Returns what makes recordings on a device; they share their memory."""
    pool, aside = torch.cuda.graph_pool_handle(), torch.cuda.Stream(device)
    return lambda function, inputs: Recording(function, inputs, pool, aside)
