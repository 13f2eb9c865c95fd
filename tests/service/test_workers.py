"""File workers: what waits is written together, once, and in time or not at all."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from typing import Any
from unittest.mock import AsyncMock

import numpy as np
import pytest

from latentmotion.motion import Motion
from latentmotion.pipeline import RawMotion
from latentmotion.service import worker, workers
from latentmotion.service.metrics import Metrics
from latentmotion.service.problems import Problem
from latentmotion.service.workers import FileWorkers, WorkerError, written
from tests.service.conftest import Called
from tests.support.walker import walker

Batches = list[list[str]]


def task(name: str, motions: int = 1) -> dict[str, Any]:
    return {"verb": "write", "name": name, "motions": [{}] * motions}


def with_workers(
    talk: Callable[[FileWorkers, Batches, asyncio.Event], Awaitable[None]],
    monkeypatch: pytest.MonkeyPatch,
    **options: int,
) -> Batches:
    """Returns the batches of tasks that processes were given, which answer when they are let go."""
    batches: Batches = []

    async def run_it() -> None:
        sizes = {"count": 1, "waiting": 20, **options}
        found, go = FileWorkers(**sizes, metrics=Metrics()), asyncio.Event()

        async def exchange(process: Any, batch: Any) -> Any:
            names = [task["name"] for task, _ in batch]
            batches.append(names)
            await go.wait()
            if "kills" in names:
                raise OSError
            return [({"done": name}, b"") for name in names]

        monkeypatch.setattr(workers, "_exchange", exchange)
        monkeypatch.setattr(found, "_start", AsyncMock(return_value=AsyncMock(returncode=None)))
        monkeypatch.setattr(found, "_end", AsyncMock(return_value=None))
        await talk(found, batches, go)

    asyncio.run(run_it())
    return batches


async def begun(batches: Batches, count: int = 1) -> None:
    while len(batches) < count:
        await asyncio.sleep(0)


def test_files_of_one_motion_are_written_together(monkeypatch: pytest.MonkeyPatch) -> None:
    async def talk(found: FileWorkers, batches: Batches, go: asyncio.Event) -> None:
        asked = [asyncio.ensure_future(found.run(task("first")))]
        await begun(batches)
        names = "abcdefghij"
        asked += [asyncio.ensure_future(found.run(task(n, 2 if n == "c" else 1))) for n in names]
        await asyncio.sleep(0)
        go.set()
        answers = await asyncio.gather(*asked)
        assert [head["done"] for head, _ in answers] == ["first", *names]

    batches = with_workers(talk, monkeypatch)
    assert batches == [["first"], [*"abdefghi"], ["c"], ["j"]]


def test_all_processes_get_some_of_what_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    async def talk(found: FileWorkers, batches: Batches, go: asyncio.Event) -> None:
        asked = [asyncio.ensure_future(found.run(task(name))) for name in "abcde"]
        await begun(batches, 2)
        go.set()
        await asyncio.gather(*asked)

    assert with_workers(talk, monkeypatch, count=2) == [["a", "b", "c"], ["d"], ["e"]]


def test_what_ends_a_process_is_tried_again_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    async def talk(found: FileWorkers, batches: Batches, go: asyncio.Event) -> None:
        first = asyncio.ensure_future(found.run(task("first")))
        await begun(batches)
        asked = [asyncio.ensure_future(found.run(task(name))) for name in ("a", "kills", "b")]
        await asyncio.sleep(0)
        go.set()
        await first
        a, killing, b = await asyncio.gather(*asked, return_exceptions=True)
        assert isinstance(killing, WorkerError) and "ended 2 times" in str(killing)
        assert (a, b) == (({"done": "a"}, b""), ({"done": "b"}, b""))
        assert not found._tasks

    batches = with_workers(talk, monkeypatch, tries=2)
    assert batches == [["first"], ["a", "kills", "b"], ["a"], ["kills"], ["b"]]


def test_what_is_not_begun_in_time_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    async def talk(found: FileWorkers, batches: Batches, go: asyncio.Event) -> None:
        first = asyncio.ensure_future(found.run(task("first")))
        await begun(batches)
        with pytest.raises(Problem, match="not done in time; try again") as told:
            await found.run(task("late"), seconds=0.001)
        assert told.value.status_code == 503
        gone = asyncio.ensure_future(found.run(task("gone")))
        await asyncio.sleep(0)
        gone.cancel()
        last = asyncio.ensure_future(found.run(task("last")))
        await asyncio.sleep(0)
        go.set()
        await asyncio.gather(first, last)

    assert with_workers(talk, monkeypatch) == [["first"], ["last"]]


def test_a_process_that_takes_too_long_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    async def talk(found: FileWorkers, batches: Batches, go: asyncio.Event) -> None:
        with pytest.raises(WorkerError, match="not done in time"):
            await found.run(task("hangs"), seconds=0.05)
        go.set()
        assert (await found.run(task("next")))[0] == {"done": "next"}

    assert with_workers(talk, monkeypatch) == [["hangs"], ["next"]]


def test_files_that_would_be_too_late_are_refused_before_their_motions_are_made() -> None:
    metrics = Metrics()
    found = FileWorkers(2, 20, metrics)
    found._seconds_each = 10.0  # as on a machine that has no time for the service
    with ExitStack() as places:
        for _ in range(5):
            places.enter_context(found.place(30.0))
        with pytest.raises(Problem, match="5 files are asked for") as told, found.place(25.0):
            pass
        assert told.value.status_code == 429
        assert (told.value.headers or {})["Retry-After"] == "30"
    assert b'latentmotion_shed_total{reason="files late"} 1.0' in metrics.text()
    found._seconds_each = 1000.0
    with found.place(1.0):
        pass  # whoever comes first is tried, so that what is measured can change


def test_a_request_has_one_deadline(called: Called, monkeypatch: pytest.MonkeyPatch) -> None:
    service, left = called.service, list[float]()
    submit, run = service.batcher.submit, service.writers.run

    async def submitted(key: Any, payloads: Any, seconds: float, *others: Any) -> Any:
        left.append(seconds)
        return await submit(key, payloads, seconds, *others)

    async def ran(work: Any, content: bytes, seconds: float) -> Any:
        left.append(seconds)
        return await run(work, content, seconds)

    monkeypatch.setattr(service.batcher, "submit", submitted)
    monkeypatch.setattr(service.writers, "run", ran)
    assert called.post("/v1/motions", {"prompt": "a jump", "format": "glb"}).status_code == 200
    generated, wrote = left
    assert wrote < generated <= service.settings.deadline


def test_a_request_whose_file_would_be_late_is_not_generated(
    called: Called, monkeypatch: pytest.MonkeyPatch
) -> None:
    writers = called.service.writers
    monkeypatch.setattr(writers, "_seconds_each", 100.0)
    monkeypatch.setattr(called.service.batcher, "submit", AsyncMock(side_effect=AssertionError))
    with writers.place(1000.0):
        answer = called.post("/v1/motions", {"prompt": "a jump", "format": "glb"})
    assert answer.status_code == 429
    assert "more would not be done in time" in answer.json()["detail"]


@pytest.mark.parametrize("form", ["glb", "npz"])
def test_files_written_together_are_what_they_are_alone(form: str) -> None:
    joints = walker(30).joints()
    noise = np.random.default_rng(0).normal(0, 0.005, (3, *joints.shape))
    motions = [RawMotion(Motion(joints + one, caption=str(n))) for n, one in enumerate(noise)]
    tasks = [written([one], form, one is not motions[2], None) for one in motions]
    tasks.append(written(motions[:2], form, True, 30.0))
    together = worker.answers(tasks)
    assert together == [worker.answer(*one) for one in tasks]
    wrong = json.loads(json.dumps(tasks[0][0]))
    wrong["motions"][0]["fps"] = 0
    heads = [head for head, _ in worker.answers([tasks[1], (wrong, tasks[0][1]), tasks[2]])]
    assert "fps is 0" in heads[1]["error"]
    assert heads[0] == heads[2] == {"format": form}
