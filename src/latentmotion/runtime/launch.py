"""How a function of tensors is run: directly, or as a CUDA graph that was recorded once per shape.

A recording replays thousands of kernels with one launch, so a GPU never waits for Python.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

Function = Callable[..., Tensor]
"""Tensors of one device to a tensor, without a look at the host's memory."""

MOST = 32
"""Recordings that are kept; the one unused for longest goes."""
WARM_UP = 3
"""Runs before a recording, in which libraries choose their kernels."""


@runtime_checkable
class Launcher(Protocol):
    """Runs functions."""

    def __call__(self, name: Hashable, function: Function, *inputs: Tensor) -> Tensor:
        """Returns the function's output.

        Args:
            name: Equal for functions that do the same.
            function: What is run.
            inputs: Its inputs.
        """
        ...


def directly(name: Hashable, function: Function, *inputs: Tensor) -> Tensor:
    """Runs a function kernel by kernel."""
    return function(*inputs)


class Recording:
    """A function on a GPU, recorded for inputs of these shapes.

    Args:
        function: What is recorded.
        inputs: Inputs of the shapes; their values do not matter.
        pool: Memory that recordings share, since no two of them run at once.
    """

    def __init__(self, function: Function, inputs: tuple[Tensor, ...], pool: Any) -> None:
        self._inputs = [given.clone() for given in inputs]
        self._warm_up(function)
        self._graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self._graph, pool=pool):
            self._output = function(*self._inputs)

    def __call__(self, *inputs: Tensor) -> Tensor:
        """Replays it on other inputs of the same shapes."""
        for kept, given in zip(self._inputs, inputs, strict=True):
            kept.copy_(given)
        self._graph.replay()
        return self._output.clone()

    def _warm_up(self, function: Function) -> None:
        aside = torch.cuda.Stream()
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):
            for _ in range(WARM_UP):
                function(*self._inputs)
        torch.cuda.current_stream().wait_stream(aside)


class Recorder:
    """Records each function once for each shape of its inputs, and replays it from then on.

    Args:
        record: Makes a recording of a function and inputs; by default as a CUDA graph.
        most: How many are kept.
    """

    def __init__(
        self,
        record: Callable[[Function, tuple[Tensor, ...]], Function] | None = None,
        most: int = MOST,
    ) -> None:
        self._record = record or _on_gpu()
        self._most = most
        self._kept: OrderedDict[Hashable, Function] = OrderedDict()
        self._one_at_a_time = Lock()

    def __call__(self, name: Hashable, function: Function, *inputs: Tensor) -> Tensor:
        """Replays the function's recording for these shapes, made where there is none."""
        shapes = tuple((tuple(given.shape), given.dtype) for given in inputs)
        with self._one_at_a_time:
            return self._recording((name, shapes), function, inputs)(*inputs)

    def _recording(self, key: Hashable, function: Function, inputs: tuple[Tensor, ...]) -> Function:
        if key not in self._kept:
            self._kept[key] = self._record(function, inputs)
        self._kept.move_to_end(key)
        if len(self._kept) > self._most:
            self._kept.popitem(last=False)
        return self._kept[key]


def _on_gpu() -> Callable[[Function, tuple[Tensor, ...]], Function]:
    pool = torch.cuda.graph_pool_handle()
    return lambda function, inputs: Recording(function, inputs, pool)
