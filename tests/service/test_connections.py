"""Connections: silent ones are closed and make room; health checks are answered all the while."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import httpx
import pytest
import websockets.sync.client
from websockets.exceptions import InvalidStatus

from latentmotion.service import batching, server
from latentmotion.service.app import create_app
from latentmotion.service.server import SPARE, Server, address, bound, configuration
from latentmotion.service.settings import Settings
from latentmotion.service.state import Service
from latentmotion.storage.children import allow_open_files


@pytest.fixture(scope="module")
def base() -> Iterator[str]:
    """Serves in a thread; yields the address."""
    app, place = create_app(Settings(file_workers=1, streams=1)), bound("127.0.0.1", 0)

    @app.get("/fails")
    async def fails() -> None:
        raise ZeroDivisionError

    server = Server(configuration(app, 5), app, 0.0)
    thread = threading.Thread(target=server.run, args=([place],))
    thread.start()
    base = address(place)
    while httpx.get(f"{base}/readyz").status_code != 200:
        time.sleep(0.05)
    yield base
    server.should_exit = True
    thread.join(60)


def opened(base: str, content: bytes = b"") -> socket.socket:
    link = socket.create_connection(("127.0.0.1", httpx.URL(base).port))
    link.settimeout(60)
    link.sendall(content)
    return link


HEAD = b"GET /livez HTTP/1.1\r\nHost: localhost\r\n"


@pytest.mark.parametrize("answered", [0, 1])
@pytest.mark.parametrize("begin", [b"GET", HEAD])
def test_a_head_that_does_not_come_is_not_waited_for(
    base: str, answered: int, begin: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "HEAD_SECONDS", 0.3)
    with opened(base, answered * (HEAD + b"\r\n")) as link:
        assert not answered or link.recv(1 << 16).startswith(b"HTTP/1.1 200")
        link.sendall(begin)
        began = time.monotonic()
        while link.recv(1 << 16):
            pass
        assert time.monotonic() - began < 30, "the idle time of a connection is 75 s"


def test_idle_connections_shut_nobody_out(base: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "CONNECTIONS_OF_ADDRESS", 40)
    allow_open_files(4 * SPARE + 500)  # both ends are of this process
    with ExitStack() as stack:
        links = [stack.enter_context(opened(base, HEAD)) for _ in range(SPARE + 100)]
        with httpx.Client(base_url=base, timeout=60) as client:
            for _ in range(3):
                assert client.get("/livez").status_code == 200
                assert client.get("/v1/models").status_code == 200
        for link in links:
            link.setblocking(False)
        closed = 0
        for link in links:
            try:
                closed += link.recv(1) == b""
            except BlockingIOError:
                pass
            except ConnectionResetError:
                closed += 1
        assert closed >= 100 - 40, "the oldest silent connections made room"


def test_requests_beyond_the_limit_are_told_and_health_is_answered(
    base: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("latentmotion.service.guard.CONNECTIONS_OF_ADDRESS", 0)
    answer = httpx.get(f"{base}/v1/models")
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
    assert httpx.get(f"{base}/livez").status_code == 200


def test_after_a_failure_the_connection_is_closed_as_told(base: str) -> None:
    with httpx.Client(base_url=base) as client:
        for _ in range(3):
            answer = client.get("/fails")
            assert (answer.status_code, answer.headers["connection"]) == (500, "close")
            assert client.get("/livez").status_code == 200


def test_one_stream_too_many_is_told_to_come_back(base: str) -> None:
    place = f"{base.replace('http', 'ws')}/v1/stream"
    with websockets.sync.client.connect(place), pytest.raises(InvalidStatus) as refused:
        websockets.sync.client.connect(place)
    assert refused.value.response.status_code == 503
    assert refused.value.response.headers["retry-after"] == "5"


def test_the_loop_is_free_while_the_worst_requests_arrive(base: str) -> None:
    worst = {"prompts": ["a person walks and waves " * 19] * 256, "format": "npz"}
    unknown = {f"field {number}": 1 for number in range(12_000)}
    times = []

    def ask(body: object) -> int:
        return httpx.post(f"{base}/v1/jobs", json=body, timeout=60).status_code

    with ThreadPoolExecutor(4) as pool, httpx.Client(base_url=base) as client:
        asked = [pool.submit(ask, body) for body in [worst, unknown] * 4]
        while not all(one.done() for one in asked):
            began = time.perf_counter()
            assert client.get("/livez").status_code == 200
            times.append(time.perf_counter() - began)
        assert [one.result() for one in asked] == [202, 422] * 4
    print(
        f"livez: {len(times)} times, median {sorted(times)[len(times) // 2]:.4f}, {max(times):.4f}"
    )


def test_the_checks_of_many_prompts_run_off_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    threads = []
    service = Service(Settings(file_workers=1))
    monkeypatch.setattr(batching, "check", lambda *_: threads.append(threading.current_thread()))
    monkeypatch.setattr(service.batcher, "submit", lambda *_: asyncio.sleep(0, []))
    asyncio.run(service.generated(object(), [], 1.0))  # type: ignore[arg-type]
    assert threads and threads[0] is not threading.main_thread()
