"""Turns: bounded resources are shared between clients, so that none can block the others.

A client is a token, where the service has several; without, all requests are one client's.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from contextvars import ContextVar
from typing import Protocol, TypeVar, runtime_checkable

CLIENT: ContextVar[str] = ContextVar("client", default="")
"""Client whose request is being handled; empty where clients are not told apart."""


@runtime_checkable
class Waiting(Protocol):
    """An item of a queue."""

    @property
    def client(self) -> str:
        """The client that it belongs to."""
        ...


W = TypeVar("W", bound=Waiting)


class Turns:
    """Clients take turns: first comes who was served the longest time ago."""

    def __init__(self) -> None:
        self._turn = 0
        self._served: dict[str, int] = {}

    def order(self, waiting: Iterable[W]) -> list[W]:
        """Returns what waits in the order of turns; each client's own stays in order."""
        before, ranked = Counter[str](), []
        for number, task in enumerate(waiting):
            rank = before[task.client], self._served.get(task.client, 0), number
            ranked.append((rank, task))
            before[task.client] += 1
        return [task for _, task in sorted(ranked, key=lambda pair: pair[0])]

    def served(self, tasks: Iterable[Waiting]) -> None:
        """Notes that tasks have had their turn."""
        for task in tasks:
            self._turn += 1
            self._served[task.client] = self._turn


def room(waiting: Counter[str], most: int, client: str) -> int:
    """Returns how many more items a client may queue.

    No client may have more than what is then left for the others (Choudhury and Hahne, Dynamic
    queue length thresholds, 1998), so that there is always some room for one that has nothing.

    Args:
        waiting: Number of waiting items by client.
        most: Most items that may wait.
        client: The client.
    """
    free = most - waiting.total()
    return (free - waiting[client] + 1) // 2 if client else free
