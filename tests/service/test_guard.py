"""Who is let in: by address, host, origin, token and size; and what answers without the model."""

from __future__ import annotations

import asyncio
import hashlib
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from latentmotion.errors import InputError
from latentmotion.service import guard
from latentmotion.service.app import create_app
from latentmotion.service.settings import Settings, check_bind, read_tokens
from tests.service.conftest import TOKEN, Called, calling, kill_writers, serving

PROTECTED = [("POST", "/v1/motions"), ("GET", "/v1/models"), ("GET", "/metrics"), ("GET", "/x")]


def answered(app: Any, method: str, path: str, **options: Any) -> httpx.Response:
    """Returns the answer of an app that never starts: no model runs."""

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.request(method, path, **options)

    return asyncio.run(ask())


@pytest.fixture(scope="module")
def protected() -> Any:
    return create_app(Settings(tokens=(hashlib.sha256(TOKEN.encode()).digest(),)))


@pytest.mark.parametrize(("method", "path"), PROTECTED)
@pytest.mark.parametrize(
    "header", [None, "", "Bearer", "Bearer x", f"Basic {TOKEN}", f"Bearer {TOKEN}x", "Bearer é"]
)
def test_nobody_is_let_in_without_a_token(
    protected: Any, method: str, path: str, header: str | None
) -> None:
    headers = {} if header is None else {"Authorization": header.encode()}
    answer = answered(protected, method, path, headers=headers)
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"].startswith("Bearer")


def test_a_token_lets_in(protected: Any) -> None:
    headers = {"Authorization": f"Bearer {TOKEN}"}
    assert answered(protected, "GET", "/v1/models", headers=headers).status_code == 200
    assert answered(protected, "GET", "/metrics", headers=headers).status_code == 200


@pytest.mark.parametrize("path", ["/", "/livez", "/openapi.json", "/assets/page.js"])
def test_what_is_nobodys_needs_no_token(protected: Any, path: str) -> None:
    assert answered(protected, "GET", path).status_code == 200


def test_tokens_are_read_plain_or_hashed(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    digest = hashlib.sha256(TOKEN.encode()).hexdigest()
    file.write_text(f"{TOKEN}\n\nsha256:{digest}\n")
    tokens = read_tokens(file)
    assert tokens[0] == tokens[1]
    assert Settings(tokens=tokens).knows(TOKEN)
    assert not Settings(tokens=tokens).knows(digest)
    assert TOKEN not in repr(Settings(tokens=tokens))


@pytest.mark.parametrize("line", ["short", "sha256:12", "a token with spaces in it", "é" * 20, ""])
def test_a_token_that_is_none_is_told(tmp_path: Path, line: str) -> None:
    (tmp_path / "tokens").write_text(f"{line}\n")
    with pytest.raises(InputError, match="token"):
        read_tokens(tmp_path / "tokens")


def test_other_machines_need_a_token() -> None:
    with pytest.raises(InputError, match="--token-file"):
        check_bind("0.0.0.0", Settings(), insecure=False)
    check_bind("0.0.0.0", Settings(), insecure=True)
    check_bind("0.0.0.0", Settings(tokens=(b"x" * 32,)), insecure=False)
    check_bind("127.0.0.1", Settings(), insecure=False)


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost", 200),
        ("LOCALHOST:80", 200),
        ("127.0.0.1:8700", 200),
        ("[::1]:80", 200),
        ("[::1]evil.example", 403),
    ]
    + [(host, 403) for host in ("evil.example", "localhost.evil.example", "127.0.0.1.nip.io", "")],
)
def test_only_known_hosts_are_served(called: Called, host: str, status: int) -> None:
    assert called.get("/livez", headers={"Host": host}).status_code == status


@pytest.mark.parametrize(
    ("origin", "status"),
    [("http://localhost", 200), ("null", 403), ("http://evil.example", 403), ("http://[", 403)],
)
def test_pages_of_others_are_refused(called: Called, origin: str, status: int) -> None:
    assert called.get("/livez", headers={"Origin": origin}).status_code == status


def test_pages_that_are_allowed_may_call_and_read_the_headers() -> None:
    page, settings = (
        "https://example.com",
        Settings(file_workers=1, origins=("https://example.com",)),
    )
    with calling(serving(settings)) as called:
        asked = {"Origin": page, "Access-Control-Request-Method": "POST"}
        asked |= {"Access-Control-Request-Headers": "content-type"}
        before = called.send("OPTIONS", "/v1/motions", headers=asked)
        assert before.status_code == 200
        assert before.headers["Access-Control-Allow-Origin"] == page
        body = {"prompt": "a person walks", "seconds": 1}
        answer = called.post("/v1/motions", body, headers={"Origin": page})
        assert answer.headers["Access-Control-Allow-Origin"] == page
        assert "LatentMotion-Seed" in answer.headers["Access-Control-Expose-Headers"]
        assert called.get("/livez", headers={"Origin": "https://example.org"}).status_code == 403
    with pytest.raises(InputError, match="expected one such as https"):
        Settings(origins=("*",))


@pytest.mark.parametrize("length", ["1000000000", "-1", "x", "9" * 40])
def test_a_length_that_cannot_be_is_refused_unread(called: Called, length: str) -> None:
    async def body() -> Any:
        raise AssertionError("read")
        yield b""

    headers = {"Content-Length": length}
    answer = called.wait(called.client.post("/v1/motions", content=body(), headers=headers))
    assert answer.status_code == 413


def test_a_body_without_a_length_ends_at_the_limit(called: Called) -> None:
    sent = 0

    async def body() -> Any:
        nonlocal sent
        while True:
            sent += 1 << 14
            yield bytes(1 << 14)

    answer = called.wait(called.client.post("/v1/motions", content=body()))
    assert answer.status_code == 413
    assert sent <= guard.LARGEST_BODY + (2 << 14)


def test_a_slow_body_is_not_awaited(called: Called, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "BODY_SECONDS", 0.05)

    async def body() -> Any:
        yield b"{"
        await asyncio.Event().wait()

    answer = called.wait(called.client.post("/v1/motions", content=body()))
    assert answer.status_code == 408


def test_a_full_queue_refuses_before_the_body_is_read(called: Called) -> None:
    body, sent = bytearray(), []

    async def receive() -> dict[str, Any]:
        body.extend(b"{}")
        return {"type": "http.request", "body": b"{}", "more_body": True}

    async def ask() -> None:
        batcher = called.service.batcher
        held = [lambda: (begun.set(), stop.wait(30))]
        tasks = [asyncio.ensure_future(batcher.submit(object(), held, 30.0))]
        await asyncio.to_thread(begun.wait, 30)
        tasks.append(asyncio.ensure_future(batcher.submit(object(), [int] * 8, 30.0)))
        await asyncio.sleep(0)
        scope = {"type": "http", "method": "POST", "path": "/v1/motions", "query_string": b""}
        scope |= {"headers": [(b"host", b"localhost")], "raw_path": b"/v1/motions"}
        await called.app(scope, receive, keep)
        stop.set()
        await asyncio.gather(*tasks)

    async def keep(message: dict[str, Any]) -> None:
        sent.append(message)

    begun, stop = threading.Event(), threading.Event()
    called.wait(ask())
    assert sent[0]["status"] == 429 and not body
    headers = dict(sent[0]["headers"])
    assert int(headers[b"retry-after"]) >= 1 and b"connection" not in headers
    assert b"8 of 8 places" in sent[1]["body"]
    counted = called.get("/metrics").text
    assert 'latentmotion_requests_total{route="/v1/motions",status="429"}' in counted


@pytest.mark.skipif(sys.platform != "linux", reason="threads have priorities of their own there")
def test_the_model_and_file_workers_yield_to_the_event_loop(called: Called) -> None:
    threads = [thread.native_id for thread in called.service.batcher._threads]
    assert called.post("/v1/motions", {"prompt": "a jump", "format": "bvh"}).status_code == 200
    (writer,) = called.service.writers._started
    niceness = [os.getpriority(os.PRIO_PROCESS, one) for one in (*threads, writer.pid)]
    assert all(one > os.getpriority(os.PRIO_PROCESS, 0) for one in niceness)


@pytest.mark.parametrize(("times", "status"), [(1, 200), (2, 503)])
def test_a_killed_file_worker_is_replaced_and_the_second_told(
    called: Called, times: int, status: int
) -> None:
    wanted = {"prompt": "a person jumps", "format": "bvh"}
    assert called.post("/v1/motions", wanted).status_code == 200

    async def ask() -> httpx.Response:
        asked = asyncio.ensure_future(called.client.post("/v1/motions", json=wanted))
        await kill_writers(called, times)
        return await asked

    answer = called.wait(ask())
    assert answer.status_code == status
    if status == 503:
        assert answer.headers["retry-after"] == "1"
        assert "the process that works on it ended 2 times" in answer.json()["detail"]
    assert called.post("/v1/motions", wanted).status_code == 200


def test_health_and_metrics_never_wait_for_the_model(called: Called) -> None:
    held, begun = threading.Event(), threading.Event()

    async def ask() -> None:
        busy = asyncio.ensure_future(
            called.service.called(lambda: (begun.set(), held.wait(60)), 60.0)
        )
        await asyncio.to_thread(begun.wait, 60)
        for path in ("/livez", "/readyz", "/metrics"):
            assert (await called.client.get(path)).status_code == 200
        assert not busy.done()
        held.set()
        await busy

    called.wait(ask())


def test_metrics_count_requests_by_route(called: Called) -> None:
    called.get("/v1/nothing")
    called.get("/v1/models")
    text = called.get("/metrics").text
    assert 'latentmotion_requests_total{route="/v1/models",status="200"}' in text
    assert 'latentmotion_requests_total{route="other",status="404"}' in text
    assert "latentmotion_queue 0.0" in text
    assert "/v1/nothing" not in text, "what clients invent is no label"


@pytest.fixture
def order() -> Iterator[list[str]]:
    yield []


def test_middleware_is_around_everything(order: list[str]) -> None:
    def layer(name: str) -> Any:
        def around(app: Any) -> Any:
            async def call(scope: Any, receive: Any, send: Any) -> None:
                order.append(name)
                await app(scope, receive, send)

            return call

        return around

    app = create_app(Settings(middleware=(layer("outer"), layer("inner"))))
    assert answered(app, "GET", "/livez", headers={"Host": "evil.example"}).status_code == 403
    assert order == ["outer", "inner"]


@pytest.mark.parametrize(
    "wrong", [{"queue": 0}, {"threads": 0}, {"batch": 1000}, {"deadline": float("nan")}]
)
def test_settings_out_of_range_are_told(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="expected"):
        Settings(**wrong)
