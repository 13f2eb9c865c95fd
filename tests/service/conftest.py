"""A service in this process, for tests that call it as a program would."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Iterator
from contextlib import asynccontextmanager
from typing import Any

import httpx
import pytest

from latentmotion.service.app import create_app
from latentmotion.service.settings import Settings

TOKEN = "a-token-of-more-than-16-characters"


@asynccontextmanager
async def serving(settings: Settings, ready: bool = True) -> AsyncIterator[httpx.AsyncClient]:
    """Yields a client of a service that runs, and its app as `client.app`."""
    app = create_app(settings)
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    called = httpx.AsyncClient(transport=transport, base_url="http://localhost")
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

    def wait(self, work: Awaitable[Any]) -> Any:
        return self.loop.run_until_complete(work)

    def get(self, path: str, **options: Any) -> httpx.Response:
        return self.wait(self.client.get(path, **options))

    def post(self, path: str, body: Any = None, **options: Any) -> httpx.Response:
        return self.wait(self.client.post(path, json=body, **options))


@pytest.fixture(scope="session")
def called() -> Iterator[Called]:
    loop = asyncio.new_event_loop()
    context = serving(Settings(file_workers=1, queue=8))
    client = loop.run_until_complete(context.__aenter__())
    yield Called(loop, client)
    loop.run_until_complete(context.__aexit__(None, None, None))
    loop.close()
