"""The client of Python programs, against a service in this process and a real one."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread

import httpx
import numpy as np
import pytest

from latentmotion import client as clients
from latentmotion.client import Client, ServiceError
from latentmotion.errors import LatentMotionError
from tests.service.conftest import Called, InLoop
from tests.support.pages import walking

Handler = Callable[[httpx.Request], httpx.Response]


def answering(handler: Handler) -> Client:
    return Client("http://service", transport=httpx.MockTransport(handler))


def talking(called: Called, talk: Callable[[Client], None]) -> None:
    """Lets a client talk to a service that runs in this process."""

    def run() -> None:
        with Client("http://localhost", transport=InLoop(called)) as client:
            talk(client)

    called.wait(asyncio.to_thread(run))


def test_motions_come_back_as_motions(called: Called, tmp_path: Path) -> None:
    def talk(client: Client) -> None:
        motion = client.motion("a person walks", seconds=1, seed=4)
        assert (motion.caption, len(motion), motion.metadata["seed"]) == ("a person walks", 20, 4)
        first, second = client.batch(["a person walks", "a person jumps"], seconds=1, seed=4)
        np.testing.assert_array_equal(first.joints, motion.joints)
        assert second.caption == "a person jumps"
        assert client.models()[0]["name"] == "fast"

        walking(1.0).save(tmp_path / "walk.bvh")
        assert client.clean(tmp_path / "walk.bvh").startswith(b"glTF")
        assert client.convert(tmp_path / "walk.bvh", "csv", fps=10).count(b"\n") >= 10
        found = client.retarget(tmp_path / "walk.bvh", "a person walks", "bvh", seconds=1)
        assert found.startswith(b"HIERARCHY")

        job = client.job(["a person walks"], seconds=1, seed=4, clean=False)
        (made,) = clients.read_motions(job.result())
        assert made.metadata["seed"] == 4
        job.delete()
        with pytest.raises(ServiceError, match="no such job"):
            job.state()

    talking(called, talk)


def test_a_timeline_has_its_prompts_and_parts(called: Called) -> None:
    wave = ("right_arm", "a person waves", 0.5, 1.5)

    def talk(client: Client) -> None:
        motion = client.timeline([("a person walks", 1), "a person jumps"], [wave], seed=4)
        prompts = ["a person walks", "a person jumps", "a person waves"]
        assert [span["prompt"] for span in motion.metadata["spans"]] == prompts
        assert motion.metadata["seed"] == 4

    talking(called, talk)
    sent: list[httpx.Request] = []
    refused = httpx.Response(422, json={"detail": "no"})
    client = answering(lambda request: sent.append(request) or refused)
    with client, pytest.raises(ServiceError, match="no"):
        client.timeline([("a person walks", 1), "a person jumps"], [wave], clean=False)
    assert json.loads(sent[0].content) == {
        "format": "npz",
        "clean": False,
        "timeline": [
            {"prompt": "a person walks", "seconds": 1},
            {"prompt": "a person jumps", "seconds": None},
        ],
        "timeline_parts": [
            {"part": "right_arm", "prompt": "a person waves", "start": 0.5, "end": 1.5}
        ],
    }


def test_the_services_words_are_told(called: Called) -> None:
    def talk(client: Client) -> None:
        with pytest.raises(ServiceError, match="the sentence is empty") as error:
            client.motion("")
        assert error.value.status == 422

    talking(called, talk)


def test_a_busy_service_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[float] = []
    monkeypatch.setattr(clients.time, "sleep", waited.append)
    answers = [httpx.Response(429, headers={"Retry-After": "2"}), httpx.Response(200, content=b"x")]
    with answering(lambda request: answers.pop(0)) as client:
        assert client.file("a person walks") == b"x"
    assert waited == [2]


def test_a_busy_service_is_left_at_last() -> None:
    busy = httpx.Response(503, json={"detail": "too much"}, headers={"Retry-After": "1000"})
    with answering(lambda request: busy) as client, pytest.raises(ServiceError, match="too much"):
        client._patience = 0.0
        client.models()


def test_no_service_is_told() -> None:
    with Client("http://127.0.0.1:9") as client, pytest.raises(LatentMotionError, match="no serv"):
        client.models()


OK = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n[]"
BUSY = b"HTTP/1.1 429 Busy\r\nConnection: close\r\nRetry-After: 0\r\nContent-Length: 0\r\n\r\n"
HALF = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n["
BROKEN = b"HTTP/1.1 502 Bad Gateway\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
NOBODY = b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
NOTHING = b""


class Stub:
    """A server on loopback that answers each connection as told, and closes it."""

    def __init__(self, *answers: bytes) -> None:
        self.place, self.answers, self.asked = socket.create_server(("127.0.0.1", 0)), answers, 0
        self.address = f"http://127.0.0.1:{self.place.getsockname()[1]}"
        Thread(target=self._answer, daemon=True).start()

    def _answer(self) -> None:
        for answer in self.answers:
            link = self.place.accept()[0]
            with link, link.makefile("rb") as lines:
                size = 0
                while (line := lines.readline().lower()) != b"\r\n":
                    size = int(line.split()[1]) if line.startswith(b"content-length") else size
                lines.read(size)
                self.asked += 1
                link.sendall(answer)
        self.place.close()


def models_of(address: str, patience: float = 60.0) -> object:
    with Client(address, patience=patience) as client:
        return client.models()


@pytest.mark.parametrize("first", [[NOTHING], [HALF], [BUSY], [NOTHING, BUSY, BROKEN, NOBODY]])
def test_what_was_lost_or_refused_is_asked_again(
    first: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clients, "PAUSE", 0.0)
    stub = Stub(*first, OK)
    assert models_of(stub.address) == []
    assert stub.asked == len(first) + 1


@pytest.mark.parametrize("first", [NOTHING, BUSY])
def test_nothing_is_asked_again_without_patience(first: bytes) -> None:
    stub = Stub(first, OK)
    with pytest.raises(LatentMotionError):
        models_of(stub.address, patience=0.0)
    assert stub.asked == 1


def test_lost_answers_are_given_up_after_some(monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[float] = []
    monkeypatch.setattr(clients.time, "sleep", waited.append)
    stub = Stub(*[NOTHING] * 4)
    with pytest.raises(LatentMotionError, match="no service at"):
        models_of(stub.address)
    assert stub.asked == 4
    assert waited == [0.1, 0.2, 0.4]


def test_a_job_is_not_asked_for_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    for answer, told in ((NOTHING, "no service at"), (BROKEN, "answers 502")):
        stub = Stub(answer)
        with Client(stub.address) as client, pytest.raises(LatentMotionError, match=told):
            client.job(["a person walks"])
        assert stub.asked == 1
    tries: list[str] = []

    def refuse(request: httpx.Request) -> httpx.Response:
        tries.append(request.url.path)
        raise httpx.ConnectError("refused")

    monkeypatch.setattr(clients, "PAUSE", 0.0)
    with answering(refuse) as client, pytest.raises(LatentMotionError, match="refused"):
        client.job(["a person walks"])
    assert tries == ["/v1/jobs"] * 4, "of a refused connection nothing has arrived"


def test_a_service_that_starts_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        address, answers = f"http://127.0.0.1:{place.getsockname()[1]}", []
        listens = Event()
        monkeypatch.setattr(clients.time, "sleep", lambda _: (place.listen(), listens.set()))
        call = Thread(target=lambda: answers.append(models_of(address)))
        call.start()
        assert listens.wait(60)
        with place.accept()[0] as link:
            link.recv(1 << 16)
            link.sendall(OK)
        call.join()
    assert answers == [[]]


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with (
        Client() as client,
        pytest.raises(LatentMotionError, match=r"cannot be read: No such file.*check its path"),
    ):
        client.clean(tmp_path / "none.bvh")


def test_the_token_is_sent() -> None:
    def handler(request: httpx.Request) -> httpx.Response:
        return httpx.Response(200, json=[dict(request.headers)])

    transport = httpx.MockTransport(handler)
    with Client("http://service", "a-secret", transport=transport) as client:
        assert client.models()[0]["authorization"] == "Bearer a-secret"
