"""What the service manages: motions a second, and how soon it refuses and lives at twice that.

    python -m benchmarks.generation.service

A server process with `--threads` threads of the model; clients in this process, which yields to it
(nice). "batched" and "one after the other" (batches of one) take turns. At twice capacity, requests
come at a fixed rate, however many are still open.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import count

import httpx

from benchmarks.harness.contest import figure, table
from benchmarks.harness.load import NICE, Request, load, processor, request, saturate

NUMBERS = count()
RAW = {"format": "raw", "clean": False, "seconds": 4.0}
GLB = {"format": "glb", "clean": True, "seconds": 4.0}


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2, help="that run the model")
    parser.add_argument("--clients", type=int, default=32)
    options = parser.parse_args(arguments)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    threads, measured = str(options.threads), (options.seconds, options.clients)
    with (
        served("--threads", threads) as one,
        served("--threads", threads, "--batch-size", "1") as two,
    ):
        os.nice(NICE)
        contenders = {"batched": (one, RAW), "one after the other": (two, RAW), "GLB": (one, GLB)}
        found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in contenders}
        for _ in range(options.turns):
            for name, ((address, process), body) in contenders.items():
                found[name].append(asyncio.run(throughput(address, process, body, *measured)))
        rows = []
        for name, runs in found.items():
            marks = (statistics.median(part) for part in zip(*runs, strict=True))
            rows.append([name, *map(figure, marks)])
        print(table(["requests", "a second", "CPU ms each", "motions in a batch"], rows))
        pairs = zip(found["batched"], found["one after the other"], strict=True)
        ratios = [(one[0] / two[0], two[1] / one[1]) for one, two in pairs]
        rate, cost = (statistics.median(part) for part in zip(*ratios, strict=True))
        print(f"batching: {rate:.2f} times the requests, 1/{cost:.2f} of the CPU")
        capacity = statistics.median(run[0] for run in found["batched"])
        print(asyncio.run(overload(*one, 2 * capacity, options.seconds)))
    print(f"load {os.getloadavg()[0]:.1f}")


@contextmanager
def served(*options: str) -> Iterator[tuple[str, int]]:
    """Yields the address and the process of a server."""
    command = [sys.executable, "-m", "latentmotion", "serve", "--port", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
            while httpx.get(f"{address}/readyz", timeout=60).status_code != 200:
                time.sleep(0.1)
            yield address, process.pid
        finally:
            process.terminate()


def body(about: dict[str, object]) -> bytes:
    """Returns a request of which there is no other, as no prompt is read twice."""
    number = next(NUMBERS)
    prompt = f"a person walks {number} steps and turns"
    return json.dumps({"prompt": prompt, "seed": number, **about}).encode()


async def throughput(
    address: str, process: int, about: dict[str, object], seconds: float, clients: int
) -> tuple[float, float, float]:
    """Returns answers a second, CPU milliseconds of the server for each, and motions of a batch."""
    requests = (("motion", request("POST", "/v1/motions", body(about))) for _ in count())
    await saturate(address, requests, clients, 0.5)
    cpu, batches, began = family(process), _batches(address), time.perf_counter()
    times = await saturate(address, requests, clients, seconds)
    took, spent = time.perf_counter() - began, family(process) - cpu
    done = len(times.get("motion 200", ()))
    made, runs = (now - before for now, before in zip(_batches(address), batches, strict=True))
    return done / took, 1e3 * spent / max(done, 1), made / max(runs, 1)


def _batches(address: str) -> tuple[float, float]:
    """Returns the motions and the batches that a server has made."""
    text = httpx.get(f"{address}/metrics", timeout=60).text
    return measured(text, "latentmotion_batch_size_sum"), measured(
        text, "latentmotion_batch_size_count"
    )


def measured(text: str, name: str) -> float:
    """Returns a number of `/metrics`."""
    found = re.search(rf"^{name} (\S+)", text, re.MULTILINE)
    assert found, f"/metrics has no {name}"
    return float(found[1])


def family(process: int) -> float:
    """Returns the CPU seconds of a process and those that it started."""
    with open(f"/proc/{process}/task/{process}/children", encoding="ascii") as children:  # noqa: PTH123
        return sum(map(processor, [process, *map(int, children.read().split())]))


async def overload(address: str, process: int, rate: float, seconds: float) -> str:
    """Returns what happened at a rate that is too high."""
    cpu, loop = processor(process), processor(process, process)
    times = await load(address, mixed(), rate, seconds)
    total = sum(map(len, times.values()))
    costs = [1e3 * (now - before) / total for now, before in (
        (processor(process), cpu), (processor(process, process), loop))]  # fmt: skip
    rows = []
    for name, found in sorted(times.items()):
        ordered = sorted(found)
        marks = (1e3 * ordered[int(share * len(ordered))] for share in (0.5, 0.99))
        rows.append([name, str(len(found)), *map(figure, marks)])
    text = httpx.get(f"{address}/metrics", timeout=60).text
    memory, late, counted = (
        measured(text, name)
        for name in (
            "process_resident_memory_bytes",
            "latentmotion_loop_late_seconds_sum",
            "latentmotion_loop_late_seconds_count",
        )
    )
    head = f"asked {rate:.0f} a second for {seconds:g} s; then {memory / 1e6:.0f} MB"
    cost = "CPU ms of a request: {:.2f}, of them in the event loop {:.2f}".format(*costs)
    late = f"the event loop was {1e3 * late / counted:.1f} ms late in the mean"
    answers = table(["answer", "times", "median, ms", "p99, ms"], rows)
    return f"{head}\n{cost}; {late}\n\n{answers}"


def mixed() -> Iterator[Request]:
    """Yields motions, and whether the server lives after every tenth."""
    for number in count():
        yield "motion", request("POST", "/v1/motions", body(RAW))
        if number % 10 == 9:
            yield "livez", request("GET", "/livez")


if __name__ == "__main__":
    main()
