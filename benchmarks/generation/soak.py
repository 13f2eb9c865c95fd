"""The service for a long time, with all that goes wrong: what it answers, and what it keeps.

    python -m benchmarks.generation.soak --minutes 60 --replicas 2 --output soak.md

Replicas behind the balancer of `packaging/Caddyfile` (`apt install caddy`); with one, none. Raw
motions, GLB files and `/livez` come at twice the rate that was managed at the beginning, or at
`--rate`; streams run all the time; clients hang in the middle of a request, or go before the
answer. A sixth through, a file worker of the first replica is killed by SIGKILL; a third through,
the last replica, which is started again; at two thirds it is stopped by SIGTERM and started again.
With `--small-disk`, a folder on a disk of a few megabytes, jobs fill it. In the end comes SIGTERM
for all, under load. What was found is written every minute.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import time
from collections import Counter
from collections.abc import Coroutine, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import psutil
import websockets

from benchmarks.generation.service import GLB, RAW, body
from benchmarks.harness import replicas
from benchmarks.harness.contest import figure, table
from benchmarks.harness.load import NICE, Request, Times, load, request, saturate
from benchmarks.harness.replicas import Replica
from latentmotion.storage.files import atomic_file

LAST = 20.0  # Seconds of the load in whose middle SIGTERM comes.

WARM = 30.0  # Seconds for which the rate that is managed is measured.

TOGETHER = 32  # Requests that are open meanwhile.

GONE = 3.0  # Seconds from the kill of a replica to its next start.

# Seconds after which an answer counts as lost: more than twice the time that a request may take,
# since clients yield to all else and read late where cores are few.
PATIENCE = 180.0

STREAMS = 3  # Streams that are open at the same time.

NOTICE = 5  # Seconds between saying so at `/readyz` and stopping, as in `packaging/Containerfile`.


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints what happened."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--rate", type=float, help="requests a second; else twice what is managed")
    parser.add_argument("--replicas", type=int, default=2)
    parser.add_argument("--small-disk", type=Path, help="folder of jobs, on a disk that fills")
    parser.add_argument("--output", type=Path, help="file of what was found, written every minute")
    options = parser.parse_args(arguments)
    disk = ("--jobs", str(options.small_disk)) if options.small_disk else ()
    notice = ("--notice", str(NOTICE)) if options.replicas > 1 else ()
    with replicas.replicas(options.replicas, *notice, *disk) as (address, found):
        os.nice(NICE)
        soak = _Soak(address, found, 60 * options.minutes, options.output)
        asyncio.run(soak.run(options.rate, fill=bool(disk)))
    print(soak.report())


@dataclass(frozen=True)
class _Sample:
    """What the replicas hold at one moment."""

    at: float  # Seconds since the beginning.
    memory: list[float]  # MB of each server.
    whole: list[float]  # MB of each server and its workers.
    files: int  # Open files of all.


class _Soak:
    def __init__(
        self, address: str, servers: Sequence[Replica], seconds: float, output: Path | None
    ) -> None:
        self.address, self.servers, self.seconds, self.output = address, servers, seconds, output
        self.events: Counter[str] = Counter()
        self.samples: list[_Sample] = []
        self.times: Times = {}
        self.last: Times = {}
        self.told = [f"{os.cpu_count()} cores, {len(servers)} replicas; {_load()} at the beginning"]
        self.began = time.monotonic()

    async def run(self, rate: float | None, fill: bool) -> None:
        """Runs to the end."""
        beside: list[Coroutine[Any, Any, None]] = [self._sampled(), self._rude()]
        beside += [self._streamed() for _ in range(STREAMS)]
        beside += [self._filling()] if fill else []
        if rate is None:
            rate = 2 * await self._managed()
        self.began = time.monotonic()
        self._tell(f"{rate:.1f} requests a second for {self.seconds:g} s")
        tasks = [asyncio.create_task(one) for one in beside]
        killing = asyncio.create_task(self._killing())
        await load(self.address, _requests(), rate, self.seconds, PATIENCE, self.times)
        await killing
        self._tell(f"SIGTERM for all in {LAST / 2:g} s; {_load()}")
        last = load(self.address, _requests(), rate, LAST, PATIENCE, self.last)
        asked = asyncio.create_task(last)
        await asyncio.sleep(LAST / 2)
        await asyncio.gather(*(self._stopped(one) for one in self.servers))
        await asked
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._tell(f"end; {_load()}")

    async def _managed(self) -> float:
        """Returns the motions that are answered in a second where none waits in vain."""
        times = await saturate(self.address, _requests(), TOGETHER, WARM)
        made = sum(len(found) for name, found in times.items() if name in ("raw 200", "GLB 200"))
        self._tell(f"{made / WARM:.1f} motions a second with {TOGETHER} requests open; {_load()}")
        return made / WARM

    def _tell(self, what: str) -> None:
        """Notes what happened, and writes all."""
        self.told.append(f"{time.monotonic() - self.began:.0f} s: {what}")
        if self.output:
            with atomic_file(self.output) as temporary:
                temporary.write_text(self.report(), encoding="utf-8")

    def report(self) -> str:
        """Returns all that was found so far."""
        happened = [[name, str(times)] for name, times in sorted(self.events.items())]
        parts = ["\n".join(f"* {one}" for one in self.told)]
        parts += ["Before SIGTERM for all:", _table(self.times)] if self.times else []
        parts += ["Around SIGTERM for all:", _table(self.last)] if self.last else []
        parts += [table(["what happened", "times"], happened)] if happened else []
        return "\n\n".join([*parts, self._kept()]) + "\n"

    def _kept(self) -> str:
        """Returns memory and open files as they were twelve times, and the most that there was."""
        every = max(1, len(self.samples) // 12)
        rows = [
            [f"{one.at:.0f} s", _joined(one.memory), _joined(one.whole), str(one.files)]
            for one in self.samples[every - 1 :: every]
        ]
        most = max((one.files for one in self.samples), default=0)
        largest = max((sum(one.whole) for one in self.samples), default=0.0)
        rows.append(["most", "", figure(largest), str(most)])
        return table(["after", "servers, MB", "with workers, MB", "open files"], rows)

    async def _sampled(self) -> None:
        """Notes memory and open files, and once a minute writes what was found."""
        for number in count():
            with suppress(psutil.Error):
                families = [family for one in self.servers if (family := one.family())]
                sizes = [[one.memory_info().rss / 1e6 for one in family] for family in families]
                files = sum(one.num_fds() for family in families for one in family)
                at, own = time.monotonic() - self.began, [size[0] for size in sizes]
                self.samples.append(_Sample(at, own, [sum(size) for size in sizes], files))
            if number % 12 == 11 and self.output:
                with atomic_file(self.output) as temporary:
                    temporary.write_text(self.report(), encoding="utf-8")
            await asyncio.sleep(5.0)

    async def _killing(self) -> None:
        """Kills a worker and a replica, and stops the replica later; each is started again."""
        first, last = self.servers[0], self.servers[-1]
        await asyncio.sleep(self.seconds / 6)
        workers = [one for one in first.family() if "service.worker" in str(one.cmdline())]
        for worker in workers[:1]:
            worker.kill()
            self._tell("a file worker of the first replica is killed")
        if len(self.servers) == 1:
            return
        await asyncio.sleep(self.seconds / 6)
        last.kill()
        self._tell("the last replica is killed")
        await asyncio.sleep(GONE)
        await self._started(last)
        await asyncio.sleep(self.seconds / 3)
        await self._stopped(last)
        await self._started(last)

    async def _started(self, server: Replica) -> None:
        server.start()
        await asyncio.to_thread(server.wait_until_ready)
        self._tell("it is ready again")

    async def _stopped(self, server: Replica) -> None:
        number = self.servers.index(server) + 1
        self._tell(f"SIGTERM for replica {number}")
        try:
            took = await asyncio.to_thread(server.terminate, 60.0)
            self._tell(f"replica {number} ended {took:.1f} s after SIGTERM")
        except subprocess.TimeoutExpired:
            self._tell(f"replica {number} still runs a minute after SIGTERM")

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

    async def _filling(self) -> None:
        """Asks for jobs, one after the other, on a disk that is too small for them."""
        async with httpx.AsyncClient(base_url=self.address, timeout=60) as client:
            while True:
                with suppress(httpx.HTTPError):
                    prompts = ["a person walks"] * 16
                    answer = await client.post("/v1/jobs", json={"prompts": prompts})
                    self.events[f"jobs: {answer.status_code}"] += 1
                await asyncio.sleep(self.seconds / 100)


def _load() -> str:
    return f"load {os.getloadavg()[0]:.1f}"


def _joined(sizes: Sequence[float]) -> str:
    return " + ".join(map(figure, sizes))


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
