"""Jobs: made in the background, taken up after a kill, with the motions that are asked for."""

from __future__ import annotations

import asyncio
import errno
import io
import json
import os
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import httpx
import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.errors import DiskFullError
from latentmotion.service import jobs, problems, worker
from latentmotion.service.schemas import BatchRequest
from latentmotion.service.settings import Settings
from tests.service.conftest import Called, kill_writers, serving

ASKED = {"prompts": ["a person walks", "a person jumps"], "seconds": 1.0, "clean": False}


async def done(client: httpx.AsyncClient, place: str) -> dict[str, Any]:
    while True:
        answer = await client.get(place)
        assert answer.status_code == 200, answer.text
        if answer.json()["state"] not in ("queued", "running"):
            return answer.json()
        await asyncio.sleep(0.02)


def test_a_job_is_made_and_deleted(called: Called) -> None:
    added = called.post("/v1/jobs", ASKED)
    assert added.status_code == 202
    place = added.headers["location"]
    assert called.wait(done(called.client, place)) == {
        "id": added.json()["id"],
        "state": "done",
        "motions": 2,
        "finished": 2,
        "error": None,
    }
    with np.load(io.BytesIO(called.get(f"{place}/result").content)) as found:
        assert found["frames"].tolist() == [20, 20]
        assert found["caption"].tolist() == ASKED["prompts"]
    assert called.wait(called.client.delete(place)).status_code == 204
    assert called.get(place).status_code == 404


@pytest.mark.parametrize("name", ["0" * 32, "..%2F..%2Fetc", "x", "0" * 31 + "%00"])
def test_an_unknown_job_is_told(called: Called, name: str) -> None:
    for path in (f"/v1/jobs/{name}", f"/v1/jobs/{name}/result"):
        assert called.get(path).status_code in (404, 422)
    assert called.wait(called.client.delete(f"/v1/jobs/{name}")).status_code in (404, 422)


def test_wrong_input_makes_no_job(called: Called) -> None:
    answer = called.post("/v1/jobs", ASKED | {"seconds": 100})
    assert answer.status_code == 422
    assert "makes motions of" in answer.json()["detail"]


class FullDisk:
    """A disk on which no file has room."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.refused = asyncio.Event()
        for name in ("write_text", "write_bytes"):
            monkeypatch.setattr(Path, name, self._refuse)

    def _refuse(self, *content: Any, **options: Any) -> None:
        self.refused.set()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_takes_no_job_and_says_so(
    called: Called, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    FullDisk(monkeypatch)
    answer = called.post("/v1/jobs", ASKED)
    assert answer.status_code == 507
    assert answer.headers["content-type"] == problems.MEDIA_TYPE
    assert answer.json()["detail"] == problems.FULL_DISK
    with pytest.raises(DiskFullError):
        jobs.Jobs(called.service, tmp_path).add(BatchRequest.model_validate(ASKED))
    assert not list(tmp_path.iterdir()), "nothing half-written"


def test_a_full_disk_takes_no_file_and_says_so(
    called: Called, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    monkeypatch.setattr(tempfile, "mkdtemp", Mock(side_effect=full))
    answer = called.wait(called.client.post("/v1/clean?source=bvh", content=b"x"))
    assert (answer.status_code, answer.json()["detail"]) == (507, problems.FULL_DISK)
    with monkeypatch.context() as patch:
        patch.setitem(worker._VERBS, "join", Mock(side_effect=full))
        assert worker.answer({"verb": "join"}, b"") == ({"full": str(full)}, b"")


def test_a_job_waits_for_room(
    called: Called, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "ROOM", 0.01)

    async def talk() -> None:
        found = jobs.Jobs(called.service, tmp_path)
        job = found.add(BatchRequest.model_validate(ASKED))
        with monkeypatch.context() as patch:
            work, disk = asyncio.ensure_future(found.work()), FullDisk(patch)
            await disk.refused.wait()
            await asyncio.sleep(0)
            assert not work.done()
            assert found.state(job.id).state in ("queued", "running")
        while found.state(job.id).state != "done":
            await asyncio.sleep(0.02)
        work.cancel()
        await asyncio.gather(work, return_exceptions=True)

    called.wait(talk())


@pytest.mark.parametrize(("times", "state"), [(1, "done"), (2, "failed")])
def test_a_job_outlives_a_file_worker_but_not_two(called: Called, times: int, state: str) -> None:
    async def talk() -> dict[str, Any]:
        killed = asyncio.ensure_future(kill_writers(called, times))
        added = await called.client.post("/v1/jobs", json=ASKED)
        await killed
        return await done(called.client, added.headers["location"])

    found = called.wait(talk())
    assert found["state"] == state
    if state == "failed":
        assert found["error"].startswith("the file was not written (the process that works on it")


def test_a_job_lets_other_files_go_first(
    called: Called, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "LOOK", 0.01)
    refused = asyncio.Event()

    async def refuse(*task: Any) -> Any:
        refused.set()
        raise problems.Problem(429, "too many files")

    async def talk() -> None:
        found = jobs.Jobs(called.service, tmp_path)
        job = found.add(BatchRequest.model_validate(ASKED))
        with monkeypatch.context() as patch:
            patch.setattr(called.service.writers, "run", refuse)
            work = asyncio.ensure_future(found.work())
            await refused.wait()
        while (state := found.state(job.id)).state in ("queued", "running"):
            await asyncio.sleep(0.02)
        work.cancel()
        await asyncio.gather(work, return_exceptions=True)
        assert (state.state, state.error) == ("done", None)

    called.wait(talk())


def test_a_service_leaves_the_filters_of_warnings_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are the process's: one thread that turns them off would undo what another one set."""

    callers: set[str] = set()
    enter = warnings.catch_warnings.__enter__

    def noted(self: warnings.catch_warnings[Any]) -> Any:
        callers.add(sys._getframe(1).f_globals["__name__"])
        return enter(self)

    async def make() -> dict[str, Any]:
        async with serving(Settings(jobs=tmp_path, file_workers=1)) as client:
            with monkeypatch.context() as patched:
                patched.setattr(warnings.catch_warnings, "__enter__", noted)
                assert (await client.get("/v1/jobs/" + "0" * 32)).status_code == 404
                added = await client.post("/v1/jobs", json=ASKED)
                return await done(client, added.headers["location"])

    assert asyncio.run(make())["error"] is None
    # Checks of types, which run in tests alone, do it for each function's first call.
    assert not {name for name in callers if not name.startswith("beartype")}


def test_what_a_killed_process_left_is_taken_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "TOGETHER", 1)
    place = tmp_path / ("a" * 32)
    place.mkdir()
    asked = ASKED | {"prompts": ["a person walks"] * 3}
    (place / "request.json").write_text(json.dumps(asked))
    (motion,) = MotionPipeline.from_pretrained(threads=1).batch(["a person walks"], 1.0, [7])
    motion.save(place / "00000.npz")

    async def take_up() -> bytes:
        async with serving(Settings(jobs=tmp_path, file_workers=1)) as client:
            assert (await done(client, f"/v1/jobs/{place.name}"))["state"] == "done"
            return (await client.get(f"/v1/jobs/{place.name}/result")).content

    with np.load(io.BytesIO(asyncio.run(take_up()))) as found:
        seeds = [json.loads(one)["seed"] for one in found["metadata"]]
    assert seeds == [7, 1, 2], "the first was there, and stays"
    assert (place / "answer.npz").is_file()
