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
from collections import defaultdict
from collections.abc import Iterator
from urllib.parse import urlsplit

Request = tuple[str, bytes]
"""A name and the bytes to send; see `request`."""

Times = dict[str, list[float]]
"""Seconds that each answer took, by name and status, or by name and how it failed."""

NICE = 10

_Link = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class UnansweredError(ConnectionError):
    """A connection that was closed without a byte of an answer."""


def request(method: str, path: str, body: bytes = b"", host: str = "localhost") -> bytes:
    """Returns the bytes of a request with a JSON body."""
    kind = f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n" if body else ""
    return f"{method} {path} HTTP/1.1\r\nHost: {host}\r\n{kind}\r\n".encode() + body


async def load(
    address: str, requests: Iterator[Request], rate: float, seconds: float, patience: float = 60.0
) -> Times:
    """Sends requests at a rate and returns what came back.

    Args:
        address: URL of the server.
        requests: What to send.
        rate: Requests a second.
        seconds: How long to send.
        patience: Seconds after which an answer counts as lost.
    """
    place, times = urlsplit(address), defaultdict(list)
    idle: list[_Link] = []

    async def sent(content: bytes, link: _Link) -> int:
        """Returns the status of an answer; keeps the connection where it stays open."""
        kept = False
        try:
            link[1].write(content)
            status, kept = await _answer(link[0])
        finally:
            (idle.append(link) if kept else link[1].close())
        return status

    async def one(name: str, content: bytes) -> None:
        began = time.perf_counter()
        try:
            async with asyncio.timeout(patience):
                while idle and idle[-1][0].at_eof():
                    idle.pop()[1].close()
                status = None
                if idle:
                    try:
                        status = await sent(content, idle.pop())
                    except UnansweredError:
                        name = f"{name} again"
                if status is None:
                    link = await asyncio.open_connection(place.hostname, place.port)
                    status = await sent(content, link)
            name = f"{name} {status}"
        except (OSError, TimeoutError, asyncio.IncompleteReadError) as error:
            name = f"{name} {type(error).__name__}"
        times[name].append(time.perf_counter() - began)

    tasks, began = set(), time.perf_counter()
    for number in range(round(rate * seconds)):
        await asyncio.sleep(max(0.0, began + number / rate - time.perf_counter()))
        task = asyncio.ensure_future(one(*next(requests)))
        tasks.add(task)
        task.add_done_callback(tasks.discard)
    await asyncio.gather(*tasks)
    for _, writer in idle:
        writer.close()
    return dict(times)


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
