"""Health checks while the worst arrives: `/livez` beside a bare server of the same framework.

    python -m benchmarks.generation.livez --seconds 60

A service with default settings, and a bare FastAPI application on uvicorn that has nothing but
`/livez`. Each has `--idle` sockets that send half a head and are opened again when they are closed.
The service gets the largest jobs that it allows, one after the other (256 prompts of 500 letters,
the longest motions, cleaned GLB files), checks and refusals included. Health checks go to both in
turns, each on a connection of its own that is kept: what both take is the machine's, what the
service takes more is its own.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import selectors
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress

import httpx
import uvicorn
from fastapi import FastAPI, Response

from benchmarks.generation.service import served
from benchmarks.harness.contest import figure, table
from benchmarks.harness.replicas import free_port, wait_until_answered
from latentmotion.storage.children import allow_open_files

HALF = b"GET /livez HTTP/1.1\r\nHost: localhost"
WHOLE = HALF + b"\r\n\r\n"

# As many motions as a job may have, with texts near the largest size.
WORST = {
    "prompts": [("a person walks forward and waves " * 16)[:490]] * 256,
    "seconds": 9.8,
    "format": "glb",
}

PAUSE = 0.02  # Seconds between two health checks.


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--idle", type=int, default=1010, help="sockets of each server")
    parser.add_argument("--bare", type=int, help="only serve /livez at this port")
    options = parser.parse_args(arguments)
    if options.bare is not None:
        uvicorn.run(bare(), port=options.bare, log_level="warning", access_log=False)
        return
    allow_open_files(4 * options.idle + 100)
    load = os.getloadavg()[0]
    with served() as (address, _), bare_server() as other:
        ports = [httpx.URL(place).port or 80 for place in (address, other)]
        with beside(held, ports, options.idle), beside(asked, address) as answers:
            time.sleep(2.0)
            found = measured(ports, options.seconds)
    print(f"{os.cpu_count()} cores, load {load:.1f} before, {os.getloadavg()[0]:.1f} at the end")
    print(f"jobs of 256 prompts asked for meanwhile: {dict(Counter(drained(answers)))}")
    rows, marks = [], []
    for name, times in zip(("the service", "a bare server"), found, strict=True):
        ordered = sorted(1e3 * one for one in times)
        marks.append([ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99, 1.0)])
        rows.append([name, str(len(ordered)), *map(figure, marks[-1])])
    rows.append(["ratio", "", *(figure(one / two) for one, two in zip(*marks, strict=True))])
    print(table(["`/livez` of", "times", "median, ms", "p99, ms", "most, ms"], rows))


def bare() -> FastAPI:
    """Returns an application that does nothing else."""
    app = FastAPI()

    @app.get("/livez", response_class=Response)
    async def livez() -> Response:
        return Response("ok\n", media_type="text/plain")

    return app


@contextmanager
def bare_server() -> Iterator[str]:
    """Yields the address of such a server, a process of its own."""
    port = free_port()
    command = [sys.executable, "-m", "benchmarks.generation.livez", "--bare", str(port)]
    with subprocess.Popen(command) as process:
        try:
            wait_until_answered(f"http://127.0.0.1:{port}/livez")
            yield f"http://127.0.0.1:{port}"
        finally:
            process.terminate()


@contextmanager
def beside(function: object, *arguments: object) -> Iterator[object]:
    """Runs a function in a process meanwhile; yields the queue that it is given."""
    context = multiprocessing.get_context("spawn")
    answers = context.Queue()
    process = context.Process(target=function, args=(answers, *arguments), daemon=True)  # type: ignore[arg-type]
    process.start()
    try:
        yield answers
    finally:
        process.terminate()


def held(_: object, ports: Sequence[int], count: int) -> None:
    """Keeps sockets open that have sent half a head."""
    allow_open_files(4 * count + 100)
    waiting = selectors.DefaultSelector()

    def opened(port: int) -> None:
        with suppress(OSError):
            link = socket.create_connection(("127.0.0.1", port))
            link.sendall(HALF)
            waiting.register(link, selectors.EVENT_READ, port)

    for port in ports:
        for _ in range(count):
            opened(port)
    while True:
        for key, _ in waiting.select():
            waiting.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]
            opened(key.data)


def asked(answers: multiprocessing.Queue[int], address: str) -> None:
    """Asks for the largest job once a second."""
    with httpx.Client(base_url=address, timeout=120) as client:
        while True:
            answers.put(client.post("/v1/jobs", json=WORST).status_code)
            time.sleep(1.0)


def drained(answers: object) -> Iterator[int]:
    """Yields what a process has put into its queue."""
    while not answers.empty():  # type: ignore[attr-defined]
        yield answers.get()  # type: ignore[attr-defined]


def measured(ports: Sequence[int], seconds: float) -> list[list[float]]:
    """Returns the seconds of health checks that go to servers in turns."""
    found: list[list[float]] = [[] for _ in ports]
    end = time.monotonic() + seconds
    with ExitStack() as stack:
        places = [("127.0.0.1", port) for port in ports]
        links = [stack.enter_context(socket.create_connection(one, 60)) for one in places]
        while time.monotonic() < end:
            for link, times in zip(links, found, strict=True):
                time.sleep(PAUSE)
                began, answer = time.perf_counter(), b""
                link.sendall(WHOLE)
                while not answer.endswith(b"ok\n"):
                    piece = link.recv(1 << 16)
                    if not piece:
                        raise ConnectionError("a health check was not answered")
                    answer += piece
                if not answer.startswith(b"HTTP/1.1 200"):
                    raise ConnectionError(f"a health check was answered by {answer[:40]!r}")
                times.append(time.perf_counter() - began)
    return found


if __name__ == "__main__":
    main()
