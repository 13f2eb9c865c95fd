"""Streams: endless, steered while they run, never further ahead than the client wants."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.control.stream import generate_stream
from latentmotion.service import streams
from tests.service.conftest import Called

Message = dict[str, Any]


class Client:
    """The other end of a WebSocket, as ASGI has it."""

    def __init__(self, app: Any, host: str = "localhost", origin: str | None = None) -> None:
        self.said: asyncio.Queue[Message] = asyncio.Queue()
        self.heard: asyncio.Queue[Message] = asyncio.Queue()
        headers = [(b"host", host.encode())]
        headers += [(b"origin", origin.encode())] if origin else []
        scope = {"type": "websocket", "path": "/v1/stream", "raw_path": b"/v1/stream"}
        scope |= {"query_string": b"", "headers": headers, "scheme": "ws", "root_path": ""}
        scope |= {"extensions": {"websocket.http.response": {}}}
        scope |= {"subprotocols": [], "client": ("127.0.0.1", 1), "server": ("localhost", 80)}
        self.said.put_nowait({"type": "websocket.connect"})
        self.task = asyncio.ensure_future(app(scope, self.said.get, self.heard.put))

    def say(self, text: str | Message) -> None:
        text = text if isinstance(text, str) else json.dumps(text)
        self.said.put_nowait({"type": "websocket.receive", "text": text})

    async def hear(self) -> Any:
        """Returns a message: JSON, joints, or the code of the close."""
        message = await asyncio.wait_for(self.heard.get(), 60)
        if message["type"] == "websocket.close":
            return message.get("code", 1000), message.get("reason", "")
        if message["type"] == "websocket.accept":
            return message
        if "text" in message:
            return json.loads(message["text"])
        return np.frombuffer(message["bytes"], "<f4").reshape(-1, 22, 3)

    async def begun(self, first: str | Message) -> None:
        assert (await self.heard.get())["type"] == "websocket.accept"
        self.say(first)

    async def leave(self) -> None:
        self.said.put_nowait({"type": "websocket.disconnect", "code": 1001})
        await asyncio.wait_for(self.task, 60)


@pytest.fixture
def streamed(called: Called) -> Callable[[Callable[[Client], Awaitable[None]]], None]:
    async def run(talk: Callable[[Client], Awaitable[None]]) -> None:
        client = Client(called.app)
        await talk(client)
        await client.leave()

    return lambda talk: called.wait(run(talk))


def test_a_stream_is_the_librarys(streamed: Any) -> None:
    async def talk(client: Client) -> None:
        await client.begun({"prompt": "a person walks", "seed": 5})
        assert (await client.hear())["fps"] == 20
        stream = generate_stream(MotionPipeline.from_pretrained(threads=1), "a person walks", 5)
        for number in (1, 2, 3):
            about, joints = await client.hear(), await client.hear()
            expected = next(stream).joints
            assert about == {"piece": number, "prompt": "a person walks", "frames": len(expected)}
            np.testing.assert_allclose(joints, expected, atol=1e-4)
            client.say({"ack": number})

    streamed(talk)


def test_a_client_that_acknowledges_nothing_gets_two_pieces(streamed: Any) -> None:
    async def talk(client: Client) -> None:
        await client.begun({"prompt": "a person walks"})
        heard = [await client.hear() for _ in range(1 + 2 * streams.AHEAD)]
        assert heard[-2]["piece"] == streams.AHEAD
        client.say({"prompt": "sits Down_1"})  # the answer to it comes, and no piece before
        assert "looks like a label" not in str(heard)
        assert "error" not in heard[-2]
        client.say("{}x")
        assert "error" in await client.hear()
        assert client.heard.empty()
        client.say({"prompt": "a person jumps", "ack": 1})
        assert (await client.hear())["prompt"] == "a person jumps"

    streamed(talk)


@pytest.mark.parametrize(
    ("first", "told"),
    [
        ("{", "Invalid JSON"),
        ({"ack": 1}, "the first message needs a prompt"),
        ({"prompt": ""}, "the sentence is empty"),
        ({"prompt": "a person walks", "steps": 3}, "takes 1, 2, 4"),
        ({"prompt": "a person walks", "speed": 3}, "speed"),
    ],
)
def test_a_first_message_that_cannot_be_used_ends_it(streamed: Any, first: Any, told: str) -> None:
    async def talk(client: Client) -> None:
        await client.begun(first)
        code, reason = await client.hear()
        assert code == streams.POLICY
        assert told in reason

    streamed(talk)


def test_a_silent_client_is_left(streamed: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "IDLE", 0.05)

    async def talk(client: Client) -> None:
        assert (await client.heard.get())["type"] == "websocket.accept"
        assert (await client.hear())[0] == streams.POLICY

    streamed(talk)


def test_a_client_that_waits_for_its_piece_stays(
    called: Called, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, come = called.service.called, asyncio.Event()

    async def held(function: Callable[[], Any], seconds: float | None) -> Any:
        await come.wait()
        return await made(function, seconds)

    monkeypatch.setattr(streams, "IDLE", 0.1)
    monkeypatch.setattr(called.service, "called", held)

    async def talk() -> None:
        client = Client(called.app)
        client.say({"prompt": "a person walks"})
        assert (await client.hear())["type"] == "websocket.accept"
        assert (await client.hear())["fps"] == 20
        await asyncio.wait({client.task}, timeout=3 * streams.IDLE)
        come.set()
        assert (await client.hear())["piece"] == 1
        await client.leave()

    called.wait(talk())


def test_a_piece_is_not_lost_to_the_deadline(
    called: Called, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float | None] = []
    submitted = called.service.batcher.submit

    async def submit(key: Any, payloads: Any, seconds: float | None, *more: Any) -> Any:
        asked.append(seconds)
        return await submitted(key, payloads, seconds, *more)

    monkeypatch.setattr(called.service.batcher, "submit", submit)

    async def talk() -> None:
        client = Client(called.app)
        await client.begun({"prompt": "a person walks"})
        assert "joints" in await client.hear()
        assert (await client.hear())["piece"] == 1
        await client.leave()

    called.wait(talk())
    assert set(asked) == {None}


def test_no_more_streams_than_are_allowed(called: Called, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(called.service, "settings", called.service.settings)
    object.__setattr__(called.service.settings, "streams", 1)

    async def talk() -> None:
        one = Client(called.app)
        assert (await one.heard.get())["type"] == "websocket.accept"
        two = Client(called.app)
        start = await two.heard.get()
        assert (start["type"], start["status"]) == ("websocket.http.response.start", 503)
        assert (b"retry-after", b"5") in start["headers"]
        await one.leave()
        three = Client(called.app)
        assert (await three.heard.get())["type"] == "websocket.accept"
        await three.leave()

    try:
        called.wait(talk())
    finally:
        object.__setattr__(called.service.settings, "streams", 32)


@pytest.mark.parametrize("who", [{"host": "evil.example"}, {"origin": "http://evil.example"}])
def test_pages_of_others_get_no_stream(called: Called, who: dict[str, str]) -> None:
    async def talk() -> None:
        start = await Client(called.app, **who).heard.get()
        assert (start["type"], start["status"]) == ("websocket.http.response.start", 403)

    called.wait(talk())
