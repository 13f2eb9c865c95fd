"""The command itself: a real server, which loses nothing when it is told to stop."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import uvicorn
from fastapi import FastAPI

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.client import Client
from latentmotion.control.stream import generate_stream
from latentmotion.service.server import Server, bound


@contextmanager
def served(*options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Yields a process of `latentmotion serve` that is ready, and its address."""
    command = [sys.executable, "-m", "latentmotion", "serve", "--port", "0", *options]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
            with Client(address, patience=120.0) as client:
                client.models()
                client.file("a person walks", "raw", seconds=1, clean=False)
            yield process, address
        finally:
            process.kill()


def arrived(address: str) -> float:
    """Returns how many motions have been asked for, besides the first."""
    text = httpx.get(f"{address}/metrics").text
    answered = re.findall(r'requests_total\{route="/v1/motions",status="200"\} (\S+)', text)
    under_way = re.findall(r"^latentmotion_open (\S+)", text, re.MULTILINE)
    return float(answered[0]) - 1 + float(under_way[0]) - 1


def test_sigterm_loses_nothing_and_streams_end(tmp_path: Path) -> None:
    with served("--batch-size", "2", "--file-workers", "1") as (process, address):
        with Client(address) as client, client.stream("a person walks", seed=5) as stream:
            expected = generate_stream(
                MotionPipeline.from_pretrained(threads=1), "a person walks", 5
            )
            for _ in range(3):
                np.testing.assert_allclose(next(stream).joints, next(expected).joints, atol=1e-4)
            stream.say("a person jumps")
            assert "a person jumps" in {next(stream).caption for _ in range(4)}

        def ask(number: int) -> httpx.Response:
            body = {"prompt": f"a person walks {number} steps", "format": "raw", "seconds": 4}
            return httpx.post(f"{address}/v1/motions", json=body, timeout=None)

        with ThreadPoolExecutor(24) as pool:
            answers = [pool.submit(ask, number) for number in range(24)]
            while arrived(address) < 24:
                assert process.poll() is None
            process.send_signal(signal.SIGTERM)
            statuses = [answer.result().status_code for answer in answers]
        assert statuses == [200] * 24
        assert process.wait(60) == -signal.SIGTERM
        with pytest.raises(httpx.ConnectError):
            httpx.get(f"{address}/livez")


class Slow(FastAPI):
    """An application whose /slow is answered when it is told to; any other path at once."""

    def __init__(self) -> None:
        super().__init__()
        self.state.service = None
        self.begun, self.go = asyncio.Event(), asyncio.Event()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["path"] == "/slow":
            self.begun.set()
            await self.go.wait()
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body"})


async def started(app: FastAPI) -> tuple[Server, socket.socket]:
    """Returns a server in this process, and its door."""
    place = bound("127.0.0.1", 0)
    config = uvicorn.Config(app, lifespan="off", log_level="error", timeout_graceful_shutdown=60)
    config.load()
    server = Server(config, app, 0.0)
    server.lifespan = config.lifespan_class(config)
    await server.startup([place])
    return server, place


Link = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def asked(link: Link, path: str = "/") -> None:
    """Sends a request and reads its answer."""
    link[1].write(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    assert (await link[0].readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 204")


def test_who_waits_at_the_door_is_answered() -> None:
    async def talk() -> None:
        server, place = await started(Slow())
        clients = [socket.create_connection(place.getsockname()) for _ in range(8)]
        for client in clients:
            client.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        await server.shutdown([place])  # nothing has been accepted until here
        for client in clients:
            assert client.recv(100).startswith(b"HTTP/1.1 204")
            client.close()

    asyncio.run(talk())


def test_open_connections_are_answered_while_work_is_left() -> None:
    async def talk() -> None:
        app = Slow()
        server, place = await started(app)
        where = place.getsockname()
        kept, busy = [await asyncio.open_connection(*where) for _ in range(2)]
        await asked(kept)
        answer = asyncio.ensure_future(asked(busy, "/slow"))
        await app.begun.wait()
        stopped = asyncio.ensure_future(server.shutdown([place]))
        while place.fileno() != -1:
            await asyncio.sleep(0)
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(*where)
        await asked(kept)
        assert not stopped.done()
        app.go.set()
        await answer
        await stopped
        for reader, writer in (kept, busy):
            assert await reader.read() == b""
            writer.close()

    asyncio.run(talk())


def test_what_cannot_be_served_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        cases = [
            (["--host", "0.0.0.0"], "--token-file"),
            (["--port", port], "cannot serve at"),
            (["--port", "70000"], "expected 0 to 65535"),
            (["--host", "no.such.host.invalid", "--insecure"], "cannot serve at"),
            (["--token-file", str(tmp_path / "none")], "tokens: "),
            (["--queue", "0"], "queue 0: expected"),
            (["--notice", "nan"], "--notice nan"),
            (["--runtime", "pytorch"], "cannot be served"),
            (["--model", "none", "--port", "0"], "none"),
            (["--asgi-middleware", "x"], "expected MODULE:CALLABLE"),
            (["--asgi-middleware", "no_such_module:x"], "no_such_module"),
            (["--asgi-middleware", "os:sep"], "cannot be called"),
        ]
        for options, told in cases:
            with pytest.raises(SystemExit) as error:
                main(["serve", *options])
            assert error.value.code == 2
            text = capsys.readouterr().err
            assert text.startswith("error: ")
            assert told in text


def test_the_extra_is_named_where_it_is_missing() -> None:
    code = (
        "import sys; sys.modules['fastapi'] = None\n"
        "from latentmotion.cli.main import main; main(['serve', '--port', '0'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert 'pip install "latentmotion[serve]"' in done.stderr
