"""What the studio's library takes with 10,000 takes, and four takes from Enter to their joints.

    python -m benchmarks.generation.studio

A real server and a client on this machine. CPU is that of the server process; on busy cores the
least of the times comes nearest to a quiet machine's.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import httpx
import numpy as np

from benchmarks.generation.service import processor
from benchmarks.harness.contest import figure, table
from latentmotion import Motion
from latentmotion.studio.library import Edits, Library

PROMPT = "a person walks forward and kicks"


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--takes", type=int, default=10_000)
    parser.add_argument("--turns", type=int, default=21)
    options = parser.parse_args(arguments)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        names = fill(Path(folder), options.takes)
        with opened(Path(folder)) as (client, server, ready):
            print(f"ready {ready:.1f} s after the command\n")
            # The worker processes start after the model; their start is no part of what follows.
            client.get(f"/studio/v1/takes/{names[0]}/file?format=csv")
            client.post("/studio/v1/import?name=none.bvh", content=b"none")
            rows = [
                [what, *measured(work, server, options.turns)]
                for what, work in asked(client, names).items()
            ]
    print(table([f"{options.takes:,} takes", "median ms", "least ms", "CPU ms"], rows))


def fill(folder: Path, count: int) -> list[str]:
    """Fills a library; returns the names of its takes."""
    library, random = Library(folder), np.random.default_rng(0)
    steps = random.normal(0, 0.02, (100, 80, 22, 3)).cumsum(axis=1)
    takes = library.add(
        (Motion(joints, caption=f"{PROMPT}, number {n}"), {"prompt": PROMPT}, f"kick {n}", Edits())
        for n, joints in enumerate(steps[:count])
    )
    library.change(takes[0].id, tags=("first",), star=True)
    copies = [library.duplicate(takes[n % len(takes)].id) for n in range(count - len(takes))]
    library.close()
    return [take.id for take in (*takes, *copies)]


@contextmanager
def opened(folder: Path) -> Iterator[tuple[httpx.Client, int, float]]:
    """Yields a client of a studio, its process, and the seconds until it was ready."""
    command = [sys.executable, "-m", "latentmotion", "studio", "--no-browser", "--port", "0"]
    began = time.perf_counter()
    with subprocess.Popen(
        [*command, "--library", str(folder)], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            address, _, token = process.stdout.readline().strip().partition("/studio#token=")
            headers = {"Authorization": f"Bearer {token}"}
            with httpx.Client(base_url=address, headers=headers, timeout=120) as client:
                while client.get("/readyz").status_code != 200:
                    time.sleep(0.02)
                yield client, process.pid, time.perf_counter() - began
        finally:
            process.terminate()


def asked(client: httpx.Client, names: Sequence[str]) -> dict[str, Callable[[], None]]:
    """Returns what is measured."""
    random = np.random.default_rng(1)

    def get(path: str) -> httpx.Response:
        answer = client.get(f"/studio/v1/{path}")
        return answer.raise_for_status()

    def some() -> str:
        return names[int(random.integers(len(names)))]

    def opened_take() -> None:
        name = some()
        get(f"takes/{name}"), get(f"takes/{name}/joints")

    def four() -> None:
        seed = int(random.integers(1 << 30))
        body = {"recipe": {"prompt": PROMPT, "seconds": 4.0, "seed": seed}, "takes": 4}
        answer = client.post("/studio/v1/takes", json=body).raise_for_status()
        get("joints?" + "&".join(f"take={take['id']}" for take in answer.json()["takes"]))

    return {
        "list the newest 100": lambda: get("takes") and None,
        "list 100 from the middle": lambda: get(f"takes?offset={len(names) // 2}") and None,
        "search two words": lambda: get("takes?query=kick%20person") and None,
        "search a tag": lambda: get("takes?tag=first&star=true") and None,
        "open one: its row and its joints": opened_take,
        "four takes of 4 s, cleaned up, and their joints": four,
    }


def measured(work: Callable[[], None], server: int, turns: int) -> list[str]:
    """Returns median and least milliseconds, and the server's CPU for each."""
    work()
    times, cpu = [], processor(server)
    for _ in range(turns):
        began = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - began))
    spent = 1e3 * (processor(server) - cpu) / turns
    return [figure(value) for value in (statistics.median(times), min(times), spent)]


if __name__ == "__main__":
    main()
