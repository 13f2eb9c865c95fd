"""The queue: what waits is run together, it is bounded, and what nobody wants is dropped."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

import httpx
import pytest

from latentmotion.engine.encoder import MemoryCachedTextEncoder
from latentmotion.errors import InputError
from latentmotion.service import state
from latentmotion.service.batching import Batcher, BatchSettings, Prompt, run
from latentmotion.service.metrics import Metrics
from latentmotion.service.problems import Problem
from latentmotion.service.settings import Settings
from latentmotion.service.state import ClientGoneError, unless_gone
from tests.service.conftest import Called


class Held:
    """A queue whose thread waits in its first batch until it is let go."""

    def __init__(self, queue: int = 4, batch: int = 3) -> None:
        self.batches: list[list[Any]] = []
        self.begun, self.go = threading.Event(), threading.Event()
        self.batcher = Batcher(self._run, queue, batch, Metrics())
        self.batcher.start(1)

    def _run(self, key: Any, payloads: Sequence[Any]) -> list[Any]:
        self.begun.set()
        assert self.go.wait(60)
        self.batches.append(list(payloads))
        return [InputError("no") if payload == "wrong" else payload for payload in payloads]

    async def first(self) -> asyncio.Future[Any]:
        task = self.ask("first")
        await asyncio.to_thread(self.begun.wait, 60)
        return task

    def ask(self, *payloads: str, key: str = "a", **options: Any) -> asyncio.Future[Any]:
        options = {"seconds": 60.0, **options}
        return asyncio.ensure_future(self.batcher.submit(key, payloads, **options))


def with_held(talk: Callable[[Held], Awaitable[None]]) -> Held:
    async def run_it() -> Held:
        held = Held()
        try:
            await talk(held)
        finally:
            held.go.set()
            await held.batcher.stop()
        return held

    return asyncio.run(run_it())


def test_what_waits_is_run_together_by_key() -> None:
    async def talk(held: Held) -> None:
        tasks = [await held.first(), held.ask("b", key="b"), held.ask("c"), held.ask("d", key="b")]
        await asyncio.sleep(0)
        held.go.set()
        assert await asyncio.gather(*tasks) == [["first"], ["b"], ["c"], ["d"]]

    assert with_held(talk).batches == [["first"], ["b", "d"], ["c"]]


def test_a_batch_is_no_larger_than_it_may_be() -> None:
    async def talk(held: Held) -> None:
        tasks = [await held.first(), held.ask("1", "2", "3", "4")]
        await asyncio.sleep(0)
        held.go.set()
        assert (await asyncio.gather(*tasks))[1] == ["1", "2", "3", "4"]

    assert with_held(talk).batches == [["first"], ["1", "2", "3"], ["4"]]


def test_a_full_queue_says_when_to_come_again() -> None:
    async def talk(held: Held) -> None:
        tasks = [await held.first(), held.ask("1", "2", "3")]
        await asyncio.sleep(0)
        with pytest.raises(Problem, match="3 of 4 places") as error:
            await held.ask("4", "5")
        assert error.value.status_code == 429
        assert int((error.value.headers or {})["Retry-After"]) >= 1
        with pytest.raises(Problem) as error:
            await held.ask(*"12345")
        assert error.value.status_code == 422, "they never fit"
        held.go.set()
        await asyncio.gather(*tasks)

    with_held(talk)


def test_what_would_be_too_late_is_refused_at_once() -> None:
    async def talk(held: Held) -> None:
        first = await held.first()
        held.batcher._seconds_each = 16.0  # as on a machine that has no time for the service
        second = held.ask("second")
        await asyncio.sleep(0)
        with pytest.raises(Problem, match="1 wait, and more would not be done in time") as found:
            await held.ask("third")
        assert found.value.status_code == 429
        patient = held.ask("fourth", seconds=65.0)
        held.go.set()
        assert [await first, await second, await patient] == [["first"], ["second"], ["fourth"]]

    with_held(talk)


def test_what_nobody_waits_for_is_not_run() -> None:
    async def talk(held: Held) -> None:
        first, gone, stays = await held.first(), held.ask("gone"), held.ask("stays")
        held.batcher._seconds_each = 0.0
        await asyncio.sleep(0)
        gone.cancel()
        await asyncio.gather(gone, return_exceptions=True)
        with pytest.raises(Problem, match="not done within") as error:
            await held.ask("late", seconds=0.01)
        assert error.value.status_code == 503
        held.go.set()
        await asyncio.gather(first, stays)

    assert with_held(talk).batches == [["first"], ["stays"]]


def test_what_is_in_the_background_fills_up_batches() -> None:
    async def talk(held: Held) -> None:
        tasks = [await held.first(), held.ask(*"123456", background=True), held.ask("now")]
        await asyncio.sleep(0)
        held.go.set()
        await asyncio.gather(*tasks)

    assert with_held(talk).batches == [["first"], ["now", "1", "2"], ["3", "4", "5"], ["6"]]


def test_an_error_is_that_of_one() -> None:
    async def talk(held: Held) -> None:
        first, wrong, right = await held.first(), held.ask("wrong"), held.ask("right")
        await asyncio.sleep(0)
        held.go.set()
        with pytest.raises(InputError, match="no"):
            await wrong
        assert await right == ["right"]
        await first

    with_held(talk)


def test_a_wrong_prompt_spares_its_batch(called: Called) -> None:
    pipeline, settings = called.service.pipeline, BatchSettings(None, None, None, False)
    wrong, right = Prompt("a person walks", 100.0, 0), Prompt("a person walks", 1.0, 0)
    error, motion = run(pipeline, settings, [wrong, right])
    assert isinstance(error, InputError)
    assert len(motion.motion) == 20


def test_recent_prompts_are_encoded_once(called: Called) -> None:
    inside = called.service.pipeline.condition.encoder.encoder
    read: list[str] = []

    class Encoder:
        name, width = inside.name, inside.width

        def __call__(self, sentences: Sequence[str]) -> Any:
            read.extend(sentences)
            return inside(sentences)

    encoder = MemoryCachedTextEncoder(Encoder(), most=2)
    for sentences in (["a", "b", "a"], ["b", "a"], ["c"], ["b"]):
        found, expected = encoder(sentences), inside(sentences)
        assert (found.words == expected.words).all()
        assert (found.mask == expected.mask).all()
    assert read == ["a", "b", "c", "b"]


def test_work_is_given_up_when_the_client_goes() -> None:
    class Request:
        async def receive(self) -> dict[str, Any]:
            return {"type": "http.disconnect"}

    async def ask() -> None:
        work = asyncio.get_running_loop().create_future()
        with pytest.raises(ClientGoneError):
            await unless_gone(Request(), work)  # type: ignore[arg-type]
        assert work.cancelled()

    asyncio.run(ask())


def test_a_service_that_shuts_down_takes_no_work(called: Called) -> None:
    service = called.service
    service.drain()
    try:
        for path in ("/v1/motions", "/v1/batches", "/v1/jobs", "/v1/clean?source=bvh"):
            body = {"prompts" if path[4:] in ("batches", "jobs") else "prompt": ["a person walks"]}
            body = {"prompt": "a person walks"} if "prompt" in body else body
            answer: httpx.Response = called.post(path, body)
            assert answer.status_code == 503
            assert answer.headers["retry-after"]
            assert answer.headers["connection"] == "close"
        assert called.get("/readyz").status_code == 503
        alive = called.get("/livez")
        assert (alive.status_code, alive.headers["connection"]) == (200, "close")
    finally:
        service.obstacle, service.leaving = None, False
        service.draining.clear()


def test_formats_are_loaded_before_there_are_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenUSD and ONNX Runtime, loaded at once by two threads, waited for each other for good."""
    order: list[str] = []

    def batcher(*_: object) -> None:
        raise InterruptedError

    monkeypatch.setattr(state, "lacks", lambda: order.append("formats"))
    monkeypatch.setattr(state, "Batcher", batcher)
    with pytest.raises(InterruptedError):
        state.Service(Settings())
    assert order == ["formats"]
