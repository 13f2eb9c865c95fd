"""A service in this process, for tests that call it as a program would."""

from __future__ import annotations

import asyncio
import os
import signal
import traceback
from collections.abc import AsyncIterator, Awaitable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from latentmotion.service.app import create_app
from latentmotion.service.settings import Settings

TOKEN = "a-token-of-more-than-16-characters"


@asynccontextmanager
async def serving(
    settings: Settings, ready: bool = True, app: FastAPI | None = None, token: str = ""
) -> AsyncIterator[httpx.AsyncClient]:
    """Yields a client of a service that runs, and its app as `client.app`."""
    app = app or create_app(settings)
    called_app = app

    async def logged(scope: Any, receive: Any, send: Any) -> None:
        try:
            await called_app(scope, receive, send)
        except Exception:  # the server's log would have it
            traceback.print_exc()
            raise

    transport = httpx.ASGITransport(logged, raise_app_exceptions=False)
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    called = httpx.AsyncClient(transport=transport, base_url="http://localhost", headers=headers)
    async with app.router.lifespan_context(app), called as client:
        client.app = app  # type: ignore[attr-defined]
        while ready and (await client.get("/readyz")).status_code != 200:
            await asyncio.sleep(0.01)
        yield client


class Called:
    """A client of a service that runs for a whole file of tests."""

    def __init__(self, loop: asyncio.AbstractEventLoop, client: httpx.AsyncClient) -> None:
        self.loop, self.client = loop, client
        self.app: Any = client.app  # type: ignore[attr-defined]
        self.service = self.app.state.service
        self.library: Any = None  # of a studio

    def wait(self, work: Awaitable[Any]) -> Any:
        return self.loop.run_until_complete(work)

    def get(self, path: str, **options: Any) -> httpx.Response:
        return self.wait(self.client.get(path, **options))

    def send(self, method: str, path: str, body: Any = None, **options: Any) -> httpx.Response:
        return self.wait(self.client.request(method, path, json=body, **options))

    def post(self, path: str, body: Any = None, **options: Any) -> httpx.Response:
        return self.wait(self.client.post(path, json=body, **options))


class InLoop(httpx.BaseTransport):
    """Lets a blocking client in a thread call a service that runs in this process."""

    def __init__(self, called: Called) -> None:
        self.loop, self.transport = called.loop, httpx.ASGITransport(called.app)

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        async def answered() -> httpx.Response:
            copied = httpx.Request(
                request.method, request.url, headers=request.headers, content=request.read()
            )
            answer = await self.transport.handle_async_request(copied)
            headers, content = answer.headers, await answer.aread()
            return httpx.Response(answer.status_code, headers=headers, content=content)

        return asyncio.run_coroutine_threadsafe(answered(), self.loop).result()


async def kill_writers(called: Called, times: int) -> None:
    """Kills the only process that writes files when it has a task, and its successors as well."""
    writers, killed = called.service.writers, set[int]()
    for process in writers._started:
        os.kill(process.pid, signal.SIGSTOP)  # so that it cannot be done before
    while len(killed) < times:
        await asyncio.sleep(0.01)
        found = {process.pid for process in writers._started} - killed
        if writers._tasks and found:
            (victim,) = found
            os.kill(victim, signal.SIGKILL)
            killed.add(victim)


@contextmanager
def calling(context: AbstractAsyncContextManager[httpx.AsyncClient]) -> Iterator[Called]:
    """Yields the client of a service, called from code that does not wait."""
    loop = asyncio.new_event_loop()
    client = loop.run_until_complete(context.__aenter__())
    yield Called(loop, client)
    loop.run_until_complete(context.__aexit__(None, None, None))
    loop.close()


@pytest.fixture(scope="session")
def called() -> Iterator[Called]:
    with calling(serving(Settings(file_workers=1, queue=8))) as found:
        yield found
