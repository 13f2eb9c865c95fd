"""Turns: no client keeps the others out of a queue, or out of the model."""

from __future__ import annotations

import asyncio
import threading
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import Mock

import pytest

from latentmotion.service.batching import CLIENT, Turns, room
from latentmotion.service.jobs import Jobs
from latentmotion.service.problems import Problem
from latentmotion.service.schemas import BatchRequest
from latentmotion.service.state import Service
from tests.service.conftest import Called
from tests.service.test_batching import Held, with_held


@dataclass(frozen=True)
class One:
    client: str
    number: int


def test_clients_take_turns_and_keep_their_own_order() -> None:
    turns = Turns()
    waiting = [One("a", 0), One("a", 1), One("a", 2), One("b", 3), One("c", 4)]
    assert [one.number for one in turns.order(waiting)] == [0, 3, 4, 1, 2]
    turns.served([waiting[0]])
    assert [one.number for one in turns.order(waiting[1:])] == [3, 4, 1, 2]
    alone = [One("", number) for number in range(9)]
    assert turns.order(alone) == alone


def test_a_client_leaves_room_for_others() -> None:
    waiting = Counter[str]()
    for client, expected in (("a", 32), ("b", 16), ("c", 8), ("d", 4)):
        assert room(waiting, 64, client) == expected
        waiting[client] += expected
        assert not room(waiting, 64, client)
    assert room(waiting, 64, "e") >= 1
    assert room(Counter({"": 60}), 64, "") == 4


def test_one_token_cannot_fill_the_queue_or_come_before_all_others() -> None:
    async def talk(held: Held) -> None:
        CLIENT.set("greedy")
        tasks = [await held.first()]
        tasks += [held.ask(f"greedy {n}", key=f"key {n}") for n in range(2)]
        await asyncio.sleep(0)
        with pytest.raises(Problem) as refused:
            await held.ask("greedy 2")
        assert refused.value.status_code == 429
        CLIENT.set("modest")
        tasks.append(held.ask("modest", key="another"))
        await asyncio.sleep(0)
        held.go.set()
        await asyncio.gather(*tasks)

    held = with_held(talk)
    assert held.batches == [["first"], ["modest"], ["greedy 0"], ["greedy 1"]]


def test_a_long_timeline_does_not_hold_the_model(called: Called) -> None:
    held, begun = threading.Event(), threading.Event()

    async def ask() -> None:
        wait = called.service.called(lambda: (begun.set(), held.wait(60)), 60.0)
        long = asyncio.ensure_future(wait)
        await asyncio.to_thread(begun.wait, 60)
        body = {"prompt": "a person walks", "seconds": 2, "format": "raw", "clean": False}
        assert (await called.client.post("/v1/motions", json=body)).status_code == 200
        assert not long.done()
        held.set()
        await long

    called.wait(ask())


@pytest.mark.parametrize("place", ["/v1/jobs", "/v1/batches"])
def test_the_product_of_prompts_and_count_is_bounded(called: Called, place: str) -> None:
    body = {"prompts": ["a person walks"] * 256, "count": 256}
    answer = called.post(place, body)
    assert answer.status_code == 422
    assert "256 prompts of count 256 are 65,536 motions; expected 256 at most" in answer.text


def test_jobs_of_one_token_leave_room_and_turns_for_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("latentmotion.service.jobs.MOST", 6)
    finished: list[str] = []

    async def talk() -> None:
        jobs = Jobs(Mock(spec=Service), tmp_path)

        async def finish(place: Path) -> None:
            finished.append(place.name)
            (place / "error").touch()

        monkeypatch.setattr(jobs, "_finish", finish)
        request = BatchRequest(prompts=["a walk"])
        CLIENT.set("greedy")
        greedy = [jobs.add(request).id for _ in range(3)]
        with pytest.raises(Problem, match="3 of them yours"):
            jobs.add(request)
        CLIENT.set("modest")
        modest = jobs.add(request).id
        await jobs._look()
        assert finished[:2] == [greedy[0], modest] or finished[0] == modest
        assert sorted(finished) == sorted([*greedy, modest])

    asyncio.run(talk())
