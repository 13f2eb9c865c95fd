"""Load: HTTP requests at a fixed rate, however many are still open, over connections that are kept.

It costs a fifth of what httpx does, and yields to other processes, so that what is slow is the
server. It knows as much of HTTP as our answers need. A request on a kept connection that is closed
without a byte of an answer is sent once more, on another, as RFC 9112, 9.3.1 allows for requests
that may come twice: all that are sent here.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from urllib.parse import urlsplit

Request = tuple[str, bytes]  # A name and the bytes to send; see `request`.

# Seconds that each answer took, by name and status, or by name and how it failed.
Times = dict[str, list[float]]

LOST = (502, 504)  # What a balancer answers where the server behind it was lost.

# Seconds before such a request is sent again, as the client of the package waits.
PAUSES = (0.1, 0.2, 0.4)

NICE = 10

_Link = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class UnansweredError(ConnectionError):
    """A connection that was closed without a byte of an answer."""


def request(method: str, path: str, body: bytes = b"", host: str = "localhost") -> bytes:
    """Returns the bytes of a request with a JSON body."""
    kind = f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n" if body else ""
    return f"{method} {path} HTTP/1.1\r\nHost: {host}\r\n{kind}\r\n".encode() + body


async def load(
    address: str,
    requests: Iterator[Request],
    rate: float,
    seconds: float,
    patience: float = 60.0,
    times: Times | None = None,
) -> Times:
    """Sends requests at a rate and returns what came back.

    Args:
        address: URL of the server.
        requests: What to send.
        rate: Requests a second.
        seconds: How long to send.
        patience: Seconds after which an answer counts as lost.
        times: Where what comes back is noted as it comes.
    """
    clients = _Clients(address, patience, {} if times is None else times)
    tasks, began = set(), time.perf_counter()
    for number in range(round(rate * seconds)):
        await asyncio.sleep(max(0.0, began + number / rate - time.perf_counter()))
        task = asyncio.ensure_future(clients.ask(*next(requests)))
        tasks.add(task)
        task.add_done_callback(tasks.discard)
    await asyncio.gather(*tasks)
    clients.close()
    return clients.times


async def saturate(
    address: str, requests: Iterator[Request], together: int, seconds: float
) -> Times:
    """Sends as many requests as are answered, some at a time, and returns what came back."""
    clients, end = _Clients(address, 60.0, {}), time.perf_counter() + seconds

    async def one() -> None:
        while time.perf_counter() < end:
            await clients.ask(*next(requests))

    await asyncio.gather(*(one() for _ in range(together)))
    clients.close()
    return clients.times


class _Clients:
    """Connections that are kept, and what came back over them.

    Args:
        address: URL of the server.
        patience: Seconds after which an answer counts as lost.
        times: Where what comes back is noted.
    """

    def __init__(self, address: str, patience: float, times: Times) -> None:
        self._place, self._patience, self.times = urlsplit(address), patience, times
        self._idle: list[_Link] = []

    async def ask(self, name: str, content: bytes) -> None:
        """Sends a request, and again where a balancer says that it lost the server."""
        began = time.perf_counter()
        try:
            async with asyncio.timeout(self._patience):
                for pause in (*PAUSES, None):
                    again, status = await self._once(content)
                    name = f"{name}{' again' * again} {status}"
                    if status not in LOST or pause is None:
                        break
                    await asyncio.sleep(pause)
        except (OSError, TimeoutError, asyncio.IncompleteReadError) as error:
            name = f"{name} {type(error).__name__}"
        self.times.setdefault(name, []).append(time.perf_counter() - began)

    def close(self) -> None:
        """Closes what is open."""
        for _, writer in self._idle:
            writer.close()

    async def _once(self, content: bytes) -> tuple[bool, int]:
        """Returns whether a kept connection was lost before its answer, and the status."""
        idle = self._idle
        while idle and idle[-1][0].at_eof():
            idle.pop()[1].close()
        kept = bool(idle)
        with suppress(UnansweredError) if kept else nullcontext():
            link = idle.pop() if kept else await self._opened()
            return False, await self._sent(content, link)
        return True, await self._sent(content, await self._opened())

    async def _opened(self) -> _Link:
        return await asyncio.open_connection(self._place.hostname, self._place.port)

    async def _sent(self, content: bytes, link: _Link) -> int:
        """Returns the status of an answer; keeps the connection where it stays open."""
        kept = False
        try:
            link[1].write(content)
            status, kept = await _answer(link[0])
        finally:
            (self._idle.append(link) if kept else link[1].close())
        return status


async def _answer(reader: asyncio.StreamReader) -> tuple[int, bool]:
    """Reads an answer; returns its status, and whether the connection stays open."""
    try:
        head = (await reader.readuntil(b"\r\n\r\n")).lower()
    except (ConnectionError, asyncio.IncompleteReadError) as error:
        if getattr(error, "partial", b""):
            raise
        raise UnansweredError from error
    length = head.partition(b"content-length:")[2].partition(b"\r\n")[0]
    await reader.readexactly(int(length or 0))
    return int(head.split(None, 2)[1]), b"connection: close" not in head


def processor(process: int, thread: int | None = None) -> float:
    """Returns the CPU seconds of a process, or of one of its threads."""
    where = f"/proc/{process}" + ("" if thread is None else f"/task/{thread}")
    with open(f"{where}/stat", encoding="ascii") as stat:  # noqa: PTH123
        fields = stat.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
