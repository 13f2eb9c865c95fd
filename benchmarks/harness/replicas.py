"""Replicas of the service behind the balancer of `packaging/Caddyfile`, each killed and started."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import psutil

CADDYFILE = Path(__file__).parents[2] / "packaging" / "Caddyfile"

SERVE = (sys.executable, "-m", "latentmotion", "serve")

READY = 600.0  # Seconds in which a replica or the balancer must answer.


class Replica:
    """A server at a port that it keeps when it is started again.

    Args:
        options: Further options of the command.
        starter: Thread that starts processes: they inherit how it yields to others.
    """

    def __init__(self, options: Sequence[str], starter: ThreadPoolExecutor) -> None:
        port = free_port()
        self.address = f"http://127.0.0.1:{port}"
        self._command, self._starter = [*SERVE, "--port", str(port), *options], starter
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Starts the process; `wait_until_ready` says when it answers."""
        arguments = {"stdout": subprocess.DEVNULL}
        self._process = self._starter.submit(subprocess.Popen, self._command, **arguments).result()  # type: ignore[arg-type]

    def wait_until_ready(self) -> None:
        """Returns when `/readyz` answers 200."""
        wait_until_answered(f"{self.address}/readyz")

    def family(self) -> list[psutil.Process]:
        """Returns the process and those that it started; none where it has ended."""
        try:
            own = psutil.Process(self.number)
            return [own, *own.children()]
        except psutil.Error:
            return []

    @property
    def number(self) -> int:
        """Number of the process."""
        assert self._process is not None
        return self._process.pid

    def kill(self) -> None:
        """Ends it by SIGKILL."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()

    def terminate(self, seconds: float) -> float:
        """Asks it by SIGTERM to end; returns the seconds that it took.

        Raises:
            TimeoutExpired: It runs still after `seconds`.
        """
        assert self._process is not None
        began = time.monotonic()
        self._process.send_signal(signal.SIGTERM)
        self._process.wait(seconds)
        return time.monotonic() - began


@contextmanager
def replicas(count: int, *options: str) -> Iterator[tuple[str, list[Replica]]]:
    """Yields the address to call and the replicas; of more than one it is the balancer's."""
    with ExitStack() as stack:
        starter = stack.enter_context(ThreadPoolExecutor(1))
        found = [Replica(options, starter) for _ in range(count)]
        for one in found:
            one.start()
            stack.callback(one.kill)
        for one in found:
            one.wait_until_ready()
        addresses = [one.address for one in found]
        yield addresses[0] if count == 1 else stack.enter_context(_balanced(addresses)), found


def free_port() -> int:
    """Returns a port of this machine that nobody listens at."""
    with socket.create_server(("127.0.0.1", 0)) as place:
        return place.getsockname()[1]


def wait_until_answered(url: str) -> None:
    """Returns when an address answers 200.

    Raises:
        TimeoutError: It did not in time.
    """
    end = time.monotonic() + READY
    while time.monotonic() < end:
        try:
            if httpx.get(url, timeout=10).status_code == 200:
                return
        except httpx.HTTPError:
            pass
        time.sleep(0.1)
    raise TimeoutError(f"{url} did not answer 200 within {READY:g} s")


@contextmanager
def _balanced(addresses: Sequence[str]) -> Iterator[str]:
    """Runs Caddy as `packaging/compose.yaml` does, in front of these addresses."""
    program = shutil.which("caddy")
    if program is None:
        raise SystemExit("no caddy found, the balancer of packaging/compose.yaml: apt install it")
    port = free_port()
    address, text = f"http://127.0.0.1:{port}", CADDYFILE.read_text(encoding="utf-8")
    here = f"http://:{port} {{\n\tbind 127.0.0.1\n"
    for before, now in ((r"^:8080 \{\n", here), ("one:8700 two:8700", " ".join(addresses))):
        text, changed = re.subn(before, now, text, flags=re.MULTILINE)
        assert changed == 1, f"{CADDYFILE} has no {before}"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "Caddyfile"
        file.write_text(text, encoding="utf-8")
        command = [program, "run", "--config", str(file), "--adapter", "caddyfile"]
        places = {"XDG_DATA_HOME": folder, "XDG_CONFIG_HOME": folder, "HOME": folder}
        with subprocess.Popen(
            command, env=os.environ | places, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            try:
                wait_until_answered(f"{address}/livez")
                yield address
            finally:
                process.terminate()
