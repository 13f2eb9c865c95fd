"""CUDA graphs as far as a CPU can play them: operations are written down, then done again.

What a recording must not do is an error here too: to ask the host for a number, or to bring one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any
from unittest.mock import Mock

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

_OF_THE_HOST = ("_local_scalar_dense", "lift_fresh", "nonzero", "masked_select")


class PlayedGraph(TorchDispatchMode):
    """Writes down operations inside a `with`, and does them again into the same outputs."""

    def __init__(self) -> None:
        super().__init__()
        self._done: list[tuple[Any, tuple[Any, ...], dict[str, Any], Any]] = []

    def __torch_dispatch__(
        self, operation: Any, types: Any, arguments: Any = (), options: Any = None
    ) -> Any:
        assert not any(name in str(operation) for name in _OF_THE_HOST), operation
        output = operation(*arguments, **(options or {}))
        self._done.append((operation, arguments, options or {}, output))
        return output

    def replay(self) -> None:
        """Does them again, but for views, which follow what they show."""
        for operation, arguments, options, output in self._done:
            if not any(returned.alias_info for returned in operation._schema.returns):
                _put(output, operation(*arguments, **options))


def play_graphs(patch: pytest.MonkeyPatch) -> list[torch.device]:
    """Puts these in place of CUDA's; returns the devices that recordings are made on."""
    devices: list[torch.device] = []
    kind = torch.cuda.Stream

    @contextmanager
    def standing(device: torch.device) -> Iterator[None]:
        devices.append(device)
        yield

    @contextmanager
    def recorded(graph: PlayedGraph, pool: object, stream: object, mode: str) -> Iterator[None]:
        with graph:
            yield

    patch.setattr(torch.cuda, "CUDAGraph", PlayedGraph)
    patch.setattr(torch.cuda, "Stream", lambda device: Mock(spec=kind, device=device))
    patch.setattr(torch.cuda, "current_stream", lambda: Mock(spec=kind))
    patch.setattr(torch.cuda, "graph_pool_handle", object)
    patch.setattr(torch.cuda, "graph", recorded)
    patch.setattr(torch.cuda, "device", standing)
    patch.setattr(torch.cuda, "stream", nullcontext)
    return devices


def _put(output: Any, again: Any) -> None:
    if isinstance(output, Tensor):
        output.copy_(again)
    elif isinstance(output, tuple | list):
        for one, other in zip(output, again, strict=True):
            _put(one, other)
