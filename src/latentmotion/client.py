"""Client of a service (`latentmotion serve`), for programs that have no model: sync and async.

    from latentmotion.client import Client

    with Client("http://localhost:8700", token) as service:
        motion = service.motion("a person walks forward and sits down", seconds=4, seed=7)
        motion.save("sit.bvh")

Needs `pip install "latentmotion[client]"`. A service that is busy is asked again, as long as its
answers say when; so is one whose connection is refused or lost, a few times.
"""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from latentmotion import formats
from latentmotion.errors import LatentMotionError, MissingExtraError, unreadable
from latentmotion.kinematics.skeleton import HUMANML3D, Skeleton
from latentmotion.motion import Motion

try:
    import httpx
except ModuleNotFoundError as error:
    raise MissingExtraError("latentmotion.client", "httpx", "client") from error

BUSY = (429, 503)
"""Statuses of a service that asks to be called again."""

LOST = (502, 503, 504)
"""Status codes of a load balancer without a service behind it; they have no Retry-After."""

UNDONE = ("queued", "running")
"""States of a job that has not ended."""

LARGEST_PIECE = 1 << 24
"""Bytes of a message of a stream."""

LONGEST_WAIT = 10.0
"""Seconds between two calls at most."""

RECONNECTS = 3
"""Retries of a call whose connection, or the load balancer's, was refused or lost."""

PAUSE = 0.1
"""Seconds before the first of these; each later pause is twice as long."""


class ServiceError(LatentMotionError):
    """A request that the service does not meet.

    Args:
        status: Status of HTTP.
        detail: The service's own words.
    """

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(f"the service answers {status}: {detail}")
        self.status, self.detail = status, detail


@dataclass(frozen=True)
class Request:
    """One call of a service."""

    method: str
    """Method of HTTP."""
    path: str
    """Path below the address of the service."""
    body: Any = None
    """JSON."""
    content: bytes | None = None
    """A file in place of JSON."""
    query: Mapping[str, Any] | None = None
    """Parameters of the address; None is left out."""

    @property
    def repeatable(self) -> bool:
        """Whether it may arrive twice: all but a new job, since the service keeps no other."""
        return (self.method, self.path) != ("POST", "/v1/jobs")

    def arguments(self) -> dict[str, Any]:
        """Returns the arguments of httpx."""
        query = {name: value for name, value in (self.query or {}).items() if value is not None}
        found: dict[str, Any] = {"method": self.method, "url": self.path, "params": query}
        if self.content is not None:
            headers = {"Content-Type": "application/octet-stream"}
            return {**found, "content": self.content, "headers": headers}
        return found if self.body is None else {**found, "json": self.body}


def motion_request(prompt: str, form: str, **options: Any) -> Request:
    """Returns the call for one motion."""
    return Request("POST", "/v1/motions", {"prompt": prompt, "format": form, **_given(options)})


def timeline_request(
    spans: Sequence[str | tuple[str, float | None]],
    parts: Sequence[tuple[str, str, float, float]],
    **options: Any,
) -> Request:
    """Returns the call for one motion of several prompts."""
    pairs = [(span, None) if isinstance(span, str) else span for span in spans]
    timeline = [{"prompt": prompt, "seconds": seconds} for prompt, seconds in pairs]
    keys = "part", "prompt", "start", "end"
    tracks = {
        "timeline": timeline,
        "timeline_parts": [dict(zip(keys, part, strict=True)) for part in parts],
    }
    return Request("POST", "/v1/motions", {"format": "npz", **tracks, **_given(options)})


def batch_request(prompts: Sequence[str], form: str, path: str, **options: Any) -> Request:
    """Returns the call for several motions, at once or as a job."""
    return Request("POST", path, {"prompts": list(prompts), "format": form, **_given(options)})


def file_request(verb: str, file: str | Path, form: str, **options: Any) -> Request:
    """Returns the call that sends a file.

    Raises:
        LatentMotionError: The file cannot be read.
    """
    path = Path(file)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LatentMotionError(f"{path}: cannot be read: {unreadable(error)}") from error
    query = {"source": path.suffix.lower().lstrip("."), "format": form, **options}
    return Request("POST", f"/v1/{verb}", content=content, query=query)


def read_motions(content: bytes) -> list[Motion]:
    """Returns the motions of an `.npz` answer.

    Raises:
        FileFormatError: It is damaged.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "answer.npz"
        file.write_bytes(content)
        return formats.load(file)


class _Patience:
    """Whether and when a call is sent again."""

    def __init__(self, seconds: float, repeatable: bool) -> None:
        self._end, self._repeatable, self._lost = time.monotonic() + seconds, repeatable, 0

    def wait(self, outcome: httpx.Response | httpx.HTTPError) -> float | None:
        """Returns the seconds to wait; None if the outcome stands."""
        answer = outcome if isinstance(outcome, httpx.Response) else None
        after = "" if answer is None else answer.headers.get("Retry-After", "")
        if answer is not None and answer.status_code in BUSY and after.isdecimal():
            seconds = min(float(after), LONGEST_WAIT)
        elif self._lost == RECONNECTS or not self._may_repeat(outcome):
            return None
        else:
            seconds = PAUSE * 2**self._lost
            self._lost += 1
        return seconds if time.monotonic() + seconds < self._end else None

    def _may_repeat(self, outcome: httpx.Response | httpx.HTTPError) -> bool:
        if isinstance(outcome, httpx.Response):
            return self._repeatable and outcome.status_code in LOST
        # A connection that was refused has carried nothing.
        lost = httpx.NetworkError | httpx.RemoteProtocolError
        return isinstance(outcome, lost if self._repeatable else httpx.ConnectError)


def _checked(outcome: httpx.Response | httpx.HTTPError, url: object) -> httpx.Response:
    """Raises LatentMotionError for an answer that is none, or where none came."""
    if isinstance(outcome, httpx.HTTPError):
        problem = f"no service at {url}: {outcome or type(outcome).__name__}"
        raise LatentMotionError(problem) from outcome
    if outcome.is_success:
        return outcome
    try:
        detail = str(outcome.json()["detail"])
    except (ValueError, KeyError, TypeError):
        detail = outcome.text[:200] or outcome.reason_phrase
    raise ServiceError(outcome.status_code, detail)


def _given(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _settings(url: str, token: str | None, timeout: float) -> dict[str, Any]:
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    return {"base_url": url, "headers": headers, "timeout": timeout}


class Client:
    """A service.

    Args:
        url: Its address, such as `http://localhost:8700`.
        token: Token, if the service wants one.
        timeout: Seconds that a call may take.
        patience: Seconds for which a service that is busy, or not reached, is asked again; 0 for
            never.
        transport: Transport of httpx, for tests.

    Every method raises `ServiceError` where the service refuses, and `LatentMotionError` where
    there is none.
    """

    def __init__(
        self,
        url: str = "http://localhost:8700",
        token: str | None = None,
        timeout: float = 60.0,
        patience: float = 60.0,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self._http = httpx.Client(**_settings(url, token, timeout), transport=transport)
        self._patience = patience

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def call(self, request: Request) -> httpx.Response:
        """Returns the answer to a call."""
        patience = _Patience(self._patience, request.repeatable)
        while True:
            try:
                outcome = self._http.request(**request.arguments())
            except httpx.HTTPError as error:
                outcome = error
            seconds = patience.wait(outcome)
            if seconds is None:
                return _checked(outcome, self._http.base_url)
            time.sleep(seconds)

    def motion(self, prompt: str, seconds: float | None = None, **options: Any) -> Motion:
        """Returns a motion.

        Args:
            prompt: What the person does.
            seconds: Length; by default as predicted.
            options: seed, steps, guidance, sampler, clean, fps, goals, headings, path, as the
                service's OpenAPI has them.
        """
        return read_motions(self.file(prompt, "npz", seconds=seconds, **options))[0]

    def file(self, prompt: str, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion as a file: glb, bvh, npz, csv, usdz, html, json or raw."""
        return self.call(motion_request(prompt, form, **options)).content

    def timeline(
        self,
        spans: Sequence[str | tuple[str, float | None]],
        parts: Sequence[tuple[str, str, float, float]] = (),
        **options: Any,
    ) -> Motion:
        """Returns one motion of several prompts.

        Args:
            spans: Prompts one after the other, or `(prompt, seconds)`.
            parts: What parts of the body do meanwhile: `(part, prompt, start, end)`.
            options: seed, steps, guidance, clean, fps.
        """
        return read_motions(self.call(timeline_request(spans, parts, **options)).content)[0]

    def batch(self, prompts: Sequence[str], **options: Any) -> list[Motion]:
        """Returns several motions."""
        request = batch_request(prompts, "npz", "/v1/batches", **options)
        return read_motions(self.call(request).content)

    def job(self, prompts: Sequence[str], form: str = "npz", **options: Any) -> Job:
        """Has motions made in the background."""
        added = self.call(batch_request(prompts, form, "/v1/jobs", **options))
        return Job(self, added.json()["id"])

    def clean(self, file: str | Path, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion file cleaned up."""
        return self.call(file_request("clean", file, form, **options)).content

    def convert(self, file: str | Path, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion file in another format."""
        return self.call(file_request("convert", file, form, **options)).content

    def retarget(
        self, character: str | Path, prompt: str, form: str = "glb", **options: Any
    ) -> bytes:
        """Returns a character file with a motion."""
        request = file_request("retarget", character, form, prompt=prompt, **options)
        return self.call(request).content

    def models(self) -> list[dict[str, Any]]:
        """Returns what the service's models are."""
        return self.call(Request("GET", "/v1/models")).json()

    @contextmanager
    def stream(self, prompt: str, seed: int = 0, **options: Any) -> Iterator[Stream]:
        """Opens an endless motion: iterate over its pieces, call `say` to change what is done."""
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect

        address, headers = _socket_address(self._http)
        try:
            with connect(address, additional_headers=headers, max_size=LARGEST_PIECE) as socket:
                socket.send(_first(prompt, seed, options))
                yield Stream(socket)
        except (OSError, WebSocketException) as error:
            raise LatentMotionError(f"the stream of {address} ended: {error}") from error


class Job:
    """A job of a service, made by `Client.job`."""

    def __init__(self, client: Client, name: str) -> None:
        self._client, self.name = client, name

    def state(self) -> dict[str, Any]:
        """Returns how far it is: state, motions, made, error."""
        return self._client.call(Request("GET", f"/v1/jobs/{self.name}")).json()

    def result(self, timeout: float = 3600.0) -> bytes:
        """Waits for the file and returns it.

        Raises:
            ServiceError: The job failed, or is not done in time.
        """
        end = time.monotonic() + timeout
        while self.state()["state"] in UNDONE and time.monotonic() < end:
            time.sleep(0.5)
        return self._client.call(Request("GET", f"/v1/jobs/{self.name}/result")).content

    def delete(self) -> None:
        """Ends it and removes its files."""
        self._client.call(Request("DELETE", f"/v1/jobs/{self.name}"))


class Stream:
    """An endless motion: an iterator of its pieces, each of some seconds."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._pieces = socket, _Pieces()

    def __iter__(self) -> Iterator[Motion]:
        return self

    def __next__(self) -> Motion:
        while True:
            motion = self._pieces.read(self._socket.recv())
            if motion is not None:
                self._socket.send(self._pieces.acknowledgement())
                return motion

    def say(self, prompt: str) -> None:
        """Changes what the person does, some pieces from now."""
        self._socket.send(json.dumps({"prompt": prompt}))


class AsyncClient:
    """A service, for programs with an event loop; see `Client`."""

    def __init__(
        self,
        url: str = "http://localhost:8700",
        token: str | None = None,
        timeout: float = 60.0,
        patience: float = 60.0,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self._http = httpx.AsyncClient(**_settings(url, token, timeout), transport=transport)
        self._patience = patience

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def call(self, request: Request) -> httpx.Response:
        """Returns the answer to a call."""
        patience = _Patience(self._patience, request.repeatable)
        while True:
            try:
                outcome = await self._http.request(**request.arguments())
            except httpx.HTTPError as error:
                outcome = error
            seconds = patience.wait(outcome)
            if seconds is None:
                return _checked(outcome, self._http.base_url)
            await asyncio.sleep(seconds)

    async def motion(self, prompt: str, seconds: float | None = None, **options: Any) -> Motion:
        """Returns a motion; see `Client.motion`."""
        return read_motions(await self.file(prompt, "npz", seconds=seconds, **options))[0]

    async def file(self, prompt: str, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion as a file."""
        return (await self.call(motion_request(prompt, form, **options))).content

    async def timeline(
        self,
        spans: Sequence[str | tuple[str, float | None]],
        parts: Sequence[tuple[str, str, float, float]] = (),
        **options: Any,
    ) -> Motion:
        """Returns one motion of several prompts; see `Client.timeline`."""
        answer = await self.call(timeline_request(spans, parts, **options))
        return read_motions(answer.content)[0]

    async def batch(self, prompts: Sequence[str], **options: Any) -> list[Motion]:
        """Returns several motions."""
        request = batch_request(prompts, "npz", "/v1/batches", **options)
        return read_motions((await self.call(request)).content)

    async def job(self, prompts: Sequence[str], form: str = "npz", **options: Any) -> AsyncJob:
        """Has motions made in the background."""
        added = await self.call(batch_request(prompts, form, "/v1/jobs", **options))
        return AsyncJob(self, added.json()["id"])

    async def clean(self, file: str | Path, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion file cleaned up."""
        return (await self.call(file_request("clean", file, form, **options))).content

    async def convert(self, file: str | Path, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion file in another format."""
        return (await self.call(file_request("convert", file, form, **options))).content

    async def retarget(
        self, character: str | Path, prompt: str, form: str = "glb", **options: Any
    ) -> bytes:
        """Returns a character file with a motion."""
        request = file_request("retarget", character, form, prompt=prompt, **options)
        return (await self.call(request)).content

    async def models(self) -> list[dict[str, Any]]:
        """Returns what the service's models are."""
        return (await self.call(Request("GET", "/v1/models"))).json()

    @asynccontextmanager
    async def stream(
        self, prompt: str, seed: int = 0, **options: Any
    ) -> AsyncIterator[AsyncStream]:
        """Opens an endless motion: iterate over its pieces, call `say` to change what is done."""
        from websockets.asyncio.client import connect
        from websockets.exceptions import WebSocketException

        address, headers = _socket_address(self._http)
        connected = connect(address, additional_headers=headers, max_size=LARGEST_PIECE)
        try:
            async with connected as socket:
                await socket.send(_first(prompt, seed, options))
                yield AsyncStream(socket)
        except (OSError, WebSocketException) as error:
            raise LatentMotionError(f"the stream of {address} ended: {error}") from error


class AsyncJob:
    """A job of a service, made by `AsyncClient.job`."""

    def __init__(self, client: AsyncClient, name: str) -> None:
        self._client, self.name = client, name

    async def state(self) -> dict[str, Any]:
        """Returns how far it is: state, motions, made, error."""
        return (await self._client.call(Request("GET", f"/v1/jobs/{self.name}"))).json()

    async def result(self, timeout: float = 3600.0) -> bytes:
        """Waits for the file and returns it; see `Job.result`."""
        end = time.monotonic() + timeout
        while (await self.state())["state"] in UNDONE and time.monotonic() < end:
            await asyncio.sleep(0.5)
        return (await self._client.call(Request("GET", f"/v1/jobs/{self.name}/result"))).content

    async def delete(self) -> None:
        """Ends it and removes its files."""
        await self._client.call(Request("DELETE", f"/v1/jobs/{self.name}"))


class AsyncStream:
    """An endless motion: an asynchronous iterator of its pieces, each of some seconds."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._pieces = socket, _Pieces()

    def __aiter__(self) -> AsyncIterator[Motion]:
        return self

    async def __anext__(self) -> Motion:
        while True:
            motion = self._pieces.read(await self._socket.recv())
            if motion is not None:
                await self._socket.send(self._pieces.acknowledgement())
                return motion

    async def say(self, prompt: str) -> None:
        """Changes what the person does, some pieces from now."""
        await self._socket.send(json.dumps({"prompt": prompt}))


class _Pieces:
    """Messages of a stream to motions."""

    def __init__(self) -> None:
        self._skeleton, self._fps, self._number, self._prompt = HUMANML3D, 20.0, 0, ""

    def read(self, message: str | bytes) -> Motion | None:
        """Returns the motion that a message holds, if it holds one."""
        if isinstance(message, bytes):
            joints = np.frombuffer(message, "<f4").reshape(-1, len(self._skeleton), 3)
            return Motion(joints, self._fps, self._skeleton, self._prompt)
        about = json.loads(message)
        if "error" in about:
            raise ServiceError(422, about["error"])
        if "joints" in about:
            names, parents = tuple(about["joints"]), tuple(about["parents"])
            self._fps = about["fps"]
            if names != HUMANML3D.names:
                self._skeleton = Skeleton("stream", names, parents, np.array(about["offsets"]))
        else:
            self._number, self._prompt = about["piece"], about["prompt"]
        return None

    def acknowledgement(self) -> str:
        """Returns the message that asks for one piece more."""
        return json.dumps({"ack": self._number})


def _first(prompt: str, seed: int, options: Mapping[str, Any]) -> str:
    return json.dumps({"prompt": prompt, "seed": seed, **_given(options)})


def _socket_address(http: httpx.Client | httpx.AsyncClient) -> tuple[str, dict[str, str]]:
    """Returns the address of the stream, and the header with the token."""
    address = str(http.base_url).rstrip("/").replace("http", "ws", 1) + "/v1/stream"
    token = http.headers.get("Authorization")
    return address, {"Authorization": token} if token else {}
