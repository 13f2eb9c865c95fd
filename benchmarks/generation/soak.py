"""The service for a long time, with all that goes wrong: what it answers, and what it keeps.

    python -m benchmarks.generation.soak --minutes 30 --rate 60

Raw motions, GLB files and `/livez` come at a fixed rate; a stream runs all the time; clients hang
in the middle of a request, or go before the answer. A third through, a file worker is killed by
SIGKILL. With `--small-disk`, a folder on a disk of a few megabytes, jobs fill it. In the end comes
SIGTERM, under load.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import time
from collections import Counter
from collections.abc import Coroutine, Iterator, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import psutil
import websockets

from benchmarks.generation.service import GLB, RAW, body, served
from benchmarks.harness.contest import figure, table
from benchmarks.harness.load import NICE, Request, Times, load, request

LAST = 10.0
"""Seconds of the load in whose middle SIGTERM comes."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints what happened."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate", type=float, default=60.0, help="requests a second")
    parser.add_argument("--small-disk", type=Path, help="folder of jobs, on a disk that fills")
    options = parser.parse_args(arguments)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    disk = ("--jobs", str(options.small_disk)) if options.small_disk else ()
    with served(*disk) as (address, number):
        os.nice(NICE)
        soak = _Soak(address, psutil.Process(number), 60 * options.minutes, options.rate)
        asyncio.run(soak.run(fill=bool(disk)))
    print(f"load {os.getloadavg()[0]:.1f}")


class _Soak:
    def __init__(self, address: str, server: psutil.Process, seconds: float, rate: float) -> None:
        self.address, self.server, self.seconds, self.rate = address, server, seconds, rate
        self.events: Counter[str] = Counter()
        self.samples: list[tuple[float, float, list[float], int]] = []
        self.began = time.monotonic()

    async def run(self, fill: bool) -> None:
        """Prints the tables."""
        beside: list[Coroutine[Any, Any, None]] = [
            *(self._sampled(), self._streamed(), self._rude(), self._killing()),
        ]
        tasks = [asyncio.create_task(one) for one in beside + ([self._filling()] if fill else [])]
        times = await load(self.address, _requests(), self.rate, self.seconds)
        print(f"{self.rate:g} requests a second for {self.seconds:g} s\n\n{_table(times)}\n")
        last = asyncio.create_task(load(self.address, _requests(), self.rate, LAST))
        await asyncio.sleep(LAST / 2)
        self.server.send_signal(signal.SIGTERM)
        told = time.monotonic()
        with suppress(psutil.TimeoutExpired):
            await asyncio.to_thread(self.server.wait, 60)
        ended = "ended" if not self.server.is_running() else "still ran"
        print(f"SIGTERM under load: {ended} {time.monotonic() - told:.1f} s later\n")
        print(f"{_table(await last)}\n")
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        print(table(["what happened", "times"], [[n, str(c)] for n, c in self.events.items()]))
        print(f"\n{self._kept()}")

    def _kept(self) -> str:
        """Returns memory and open files as they were six times, and the most that there was."""
        rows = []
        every = max(1, len(self.samples) // 6)
        for at, server, workers, files in self.samples[every - 1 :: every]:
            told = " + ".join(map(figure, workers))
            rows.append([f"{at:.0f} s", *map(figure, (server, server + sum(workers))), told])
            rows[-1].append(str(files))
        most = max(server + sum(workers) for _, server, workers, _ in self.samples)
        rows.append(["most", "", figure(most), "", str(max(one[3] for one in self.samples))])
        return table(["after", "server, MB", "with workers, MB", "workers", "open files"], rows)

    async def _sampled(self) -> None:
        while self.server.is_running():
            with suppress(psutil.Error):
                family = [self.server, *self.server.children()]
                server, *workers = (one.memory_info().rss / 1e6 for one in family)
                files = sum(one.num_fds() for one in family)
                self.samples.append((time.monotonic() - self.began, server, workers, files))
            await asyncio.sleep(5.0)

    async def _streamed(self) -> None:
        """Takes a stream as it comes, and begins another where it ends."""
        place = self.address.replace("http", "ws") + "/v1/stream"
        while True:
            try:
                async with websockets.connect(place, open_timeout=60) as stream:
                    await stream.send(json.dumps({"prompt": "a person walks", "seed": 1}))
                    async for message in stream:
                        about = json.loads(message) if isinstance(message, str) else {}
                        self.events["pieces of a stream"] += "piece" in about
                        self.events["errors of a stream"] += "error" in about
                        if "piece" in about:
                            await stream.send(json.dumps({"ack": about["piece"]}))
                    closed = f"{stream.close_code} {stream.close_reason}"
            except (OSError, TimeoutError, websockets.WebSocketException) as error:
                closed = str(error)
            self.events[f"stream: {closed}"] += 1
            await asyncio.sleep(1.0)

    async def _rude(self) -> None:
        """Sends half a request and hangs, or a whole one and goes."""
        place = urlsplit(self.address)
        hanging: list[asyncio.StreamWriter] = []
        try:
            for number in count():
                with suppress(OSError):
                    _, writer = await asyncio.open_connection(place.hostname, place.port)
                    whole = request("POST", "/v1/motions", body(RAW))
                    writer.write(whole[:-20] if number % 2 else whole)
                    hanging.append(writer)
                    if number % 2 == 0:
                        await asyncio.sleep(0.05)
                        hanging.pop().close()
                    self.events["hung" if number % 2 else "went before the answer"] += 1
                if len(hanging) > 20:
                    hanging.pop(0).close()
                await asyncio.sleep(0.5)
        finally:
            for writer in hanging:
                writer.close()

    async def _killing(self) -> None:
        await asyncio.sleep(self.seconds / 3)
        workers = [one for one in self.server.children() if "service.worker" in str(one.cmdline())]
        for worker in workers[:1]:
            worker.kill()
            self.events["workers killed"] += 1

    async def _filling(self) -> None:
        """Asks for jobs, one after the other, on a disk that is too small for them."""
        async with httpx.AsyncClient(base_url=self.address, timeout=60) as client:
            while True:
                with suppress(httpx.HTTPError):
                    prompts = ["a person walks"] * 16
                    answer = await client.post("/v1/jobs", json={"prompts": prompts})
                    self.events[f"jobs: {answer.status_code}"] += 1
                await asyncio.sleep(self.seconds / 100)


def _requests() -> Iterator[Request]:
    for number in count():
        if number % 10 == 9:
            yield "livez", request("GET", "/livez")
        elif number % 10 == 4:
            yield "GLB", request("POST", "/v1/motions", body(GLB))
        else:
            yield "raw", request("POST", "/v1/motions", body(RAW))


def _table(times: Times) -> str:
    rows = []
    for name, found in sorted(times.items()):
        ordered = sorted(found)
        marks = (1e3 * ordered[int(share * len(ordered))] for share in (0.5, 0.99))
        rows.append([name, str(len(found)), *map(figure, marks)])
    return table(["answer", "times", "median, ms", "p99, ms"], rows)


if __name__ == "__main__":
    main()
