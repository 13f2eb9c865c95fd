"""Client of a service (`latentmotion serve`), for programs that have no model: sync and async.

    from latentmotion.client import Client

    with Client("http://localhost:8700", token) as service:
        motion = service.motion("a person walks forward and sits down", seconds=4, seed=7)
        motion.save("sit.bvh")

Needs `pip install "latentmotion[client]"`. A service that is busy is asked again, as long as its
answers say when; so is one whose connection is refused or lost, a few times.

A method is written once, as a generator of requests and pauses without I/O; `Client` runs it where
it is called, `AsyncClient` on an event loop.
"""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from collections.abc import (
    AsyncIterator,
    Callable,
    Coroutine,
    Generator,
    Iterator,
    Mapping,
    Sequence,
)
from contextlib import asynccontextmanager, contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, Generic, ParamSpec, TypeAlias, TypeVar, overload

import numpy as np

from latentmotion import formats
from latentmotion.errors import LatentMotionError, MissingExtraError, unreadable
from latentmotion.kinematics.skeleton import HUMANML3D, Skeleton
from latentmotion.motion import Motion

try:
    import httpx
except ModuleNotFoundError as error:
    raise MissingExtraError("latentmotion.client", "httpx", "client") from error

P = ParamSpec("P")
T = TypeVar("T")

BUSY = (429, 503)  # Statuses of a service that asks to be called again.

# Status codes of a load balancer without a service behind it; they have no Retry-After.
LOST = (502, 503, 504)

UNDONE = ("queued", "running")  # States of a job that has not ended.

LARGEST_PIECE = 1 << 24  # Bytes of a message of a stream.

LONGEST_WAIT = 10.0  # Seconds between two calls at most.

RECONNECTS = 3  # Retries of a call whose connection, or the load balancer's, was refused or lost.

PAUSE = 0.1  # Seconds before the first of these; each later pause is twice as long.


class ServiceError(LatentMotionError):
    """A request that the service does not meet.

    Args:
        status: Status of HTTP.
        detail: The service's own words.
    """

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(f"the service answers {status}: {detail}")
        self.status, self.detail = status, detail


# What a request leads to; None after a pause.
Outcome: TypeAlias = "httpx.Response | httpx.HTTPError | None"

# A conversation without I/O: yields requests and pauses in seconds, is sent their outcomes.
Flow: TypeAlias = Generator[httpx.Request | float, Outcome, T]


class _Blocking:
    """Runs flows where they are called."""

    _http: Any

    def _run(self, flow: Flow[T]) -> T:
        outcome: Outcome = None
        while True:
            try:
                step = flow.send(outcome)
                if isinstance(step, httpx.Request):
                    outcome = self._http.send(step)
                else:
                    outcome = time.sleep(step)
            except StopIteration as end:
                return end.value
            except httpx.HTTPError as error:
                outcome = error


class _Awaited:
    """Runs flows on an event loop."""

    _http: Any

    async def _run(self, flow: Flow[T]) -> T:
        outcome: Outcome = None
        while True:
            try:
                step = flow.send(outcome)
                if isinstance(step, httpx.Request):
                    outcome = await self._http.send(step)
                else:
                    outcome = await asyncio.sleep(step)
            except StopIteration as end:
                return end.value
            except httpx.HTTPError as error:
                outcome = error


class _Method(Generic[P, T]):
    """A flow as a method, which blocks in `Client` and `Job`, and is awaited in the others."""

    def __init__(self, flow: Callable[Concatenate[Any, P], Flow[T]]) -> None:
        self._flow = flow

    @overload
    def __get__(self, owner: _Blocking, kind: type) -> Callable[P, T]: ...
    @overload
    def __get__(self, owner: _Awaited, kind: type) -> Callable[P, Coroutine[Any, Any, T]]: ...
    @overload
    def __get__(self, owner: None, kind: type) -> Callable[Concatenate[Any, P], Flow[T]]: ...
    def __get__(self, owner: Any, kind: type) -> Any:
        flow = self._flow

        @wraps(flow)
        def run(*arguments: P.args, **named: P.kwargs) -> Any:
            return owner._run(flow(owner, *arguments, **named))

        return flow if owner is None else run


class ClientMethods:
    """The methods of `Client`, and of `AsyncClient`, where they are awaited."""

    _http_client: type[httpx.Client] | type[httpx.AsyncClient]

    def __init__(
        self,
        url: str = "http://localhost:8700",
        token: str | None = None,
        timeout: float = 60.0,
        patience: float = 60.0,
        transport: Any = None,
    ) -> None:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._http: Any = self._http_client(
            base_url=url, headers=headers, timeout=timeout, transport=transport
        )
        self._patience = patience

    @_Method
    def motion(self, prompt: str, seconds: float | None = None, **options: Any) -> Flow[Motion]:
        """Returns a motion.

        Args:
            prompt: What the person does.
            seconds: Length; by default as predicted.
            options: seed, steps, guidance, sampler, clean, fps, goals, headings, path, as the
                service's OpenAPI has them.
        """
        return (yield from self._motions(prompt=prompt, seconds=seconds, **options))[0]

    @_Method
    def file(self, prompt: str, form: str = "glb", **options: Any) -> Flow[bytes]:
        """Returns a motion as a file: glb, bvh, npz, csv, usdz, html, json or raw."""
        return self._content("/v1/motions", prompt=prompt, format=form, **options)

    @_Method
    def timeline(
        self,
        spans: Sequence[str | tuple[str, float | None]],
        parts: Sequence[tuple[str, str, float, float]] = (),
        **options: Any,
    ) -> Flow[Motion]:
        """Returns one motion of several prompts.

        Args:
            spans: Prompts one after the other, or `(prompt, seconds)`.
            parts: What parts of the body do meanwhile: `(part, prompt, start, end)`.
            options: seed, steps, guidance, clean, fps.
        """
        pairs = [(span, None) if isinstance(span, str) else span for span in spans]
        keys = "part", "prompt", "start", "end"
        options |= {
            "timeline": [{"prompt": prompt, "seconds": seconds} for prompt, seconds in pairs],
            "timeline_parts": [dict(zip(keys, part, strict=True)) for part in parts],
        }
        return (yield from self._motions(**options))[0]

    @_Method
    def batch(self, prompts: Sequence[str], **options: Any) -> Flow[list[Motion]]:
        """Returns several motions."""
        return self._motions("/v1/batches", prompts=list(prompts), **options)

    @_Method
    def clean(self, file: str | Path, form: str = "glb", **options: Any) -> Flow[bytes]:
        """Returns a motion file cleaned up."""
        return self._from_file("clean", file, format=form, **options)

    @_Method
    def convert(self, file: str | Path, form: str = "glb", **options: Any) -> Flow[bytes]:
        """Returns a motion file in another format."""
        return self._from_file("convert", file, format=form, **options)

    @_Method
    def retarget(
        self, character: str | Path, prompt: str, form: str = "glb", **options: Any
    ) -> Flow[bytes]:
        """Returns a character file with a motion."""
        return self._from_file("retarget", character, format=form, prompt=prompt, **options)

    @_Method
    def models(self) -> Flow[list[dict[str, Any]]]:
        """Returns what the service's models are."""
        return (yield from self._answer("GET", "/v1/models")).json()

    @_Method
    def _new_job(self, prompts: Sequence[str], form: str, options: Mapping[str, Any]) -> Flow[str]:
        body = {"prompts": list(prompts), "format": form, **_given(options)}
        # The service keeps no other: a new job must not arrive twice.
        return (yield from self._answer("POST", "/v1/jobs", False, json=body)).json()["id"]

    def _content(self, path: str, **body: Any) -> Flow[bytes]:
        return (yield from self._answer("POST", path, json=_given(body))).content

    def _motions(self, path: str = "/v1/motions", **body: Any) -> Flow[list[Motion]]:
        return read_motions((yield from self._content(path, format="npz", **body)))

    def _from_file(self, verb: str, file: str | Path, **query: Any) -> Flow[bytes]:
        path = Path(file)
        try:
            content = path.read_bytes()
        except OSError as error:
            raise LatentMotionError(f"{path}: cannot be read: {unreadable(error)}") from error
        sent = {
            "params": {"source": path.suffix.lower().lstrip("."), **_given(query)},
            "content": content,
            "headers": {"Content-Type": "application/octet-stream"},
        }
        return (yield from self._answer("POST", f"/v1/{verb}", **sent)).content

    def _answer(
        self, method: str, path: str, repeatable: bool = True, **sent: Any
    ) -> Flow[httpx.Response]:
        """Sends a request, again where the service is busy or was not reached.

        Args:
            method: Method of HTTP.
            path: Path below the address of the service.
            repeatable: Whether the request may arrive twice.
            sent: Content and parameters, as httpx takes them.
        """
        end, lost = time.monotonic() + self._patience, 0
        while True:
            outcome = yield self._http.build_request(method, path, **sent)
            pause = _retry_after(outcome)
            if pause is None and lost < RECONNECTS and _lost(outcome, repeatable):
                pause = PAUSE * 2**lost
                lost += 1
            if pause is None or time.monotonic() + pause >= end:
                return _checked(outcome, self._http.base_url)
            yield pause


class Client(_Blocking, ClientMethods):
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

    _http_client = httpx.Client

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def job(self, prompts: Sequence[str], form: str = "npz", **options: Any) -> Job:
        """Has motions made in the background."""
        return Job(self, self._new_job(prompts, form, options))

    @contextmanager
    def stream(self, prompt: str, seed: int = 0, **options: Any) -> Iterator[Stream]:
        """Opens an endless motion: iterate over its pieces, call `say` to change what is done."""
        from websockets.sync.client import connect

        address, arguments = _socket(self._http)
        with _told_stream(address), connect(address, **arguments) as socket:
            socket.send(json.dumps({"prompt": prompt, "seed": seed, **_given(options)}))
            yield Stream(socket)


class AsyncClient(_Awaited, ClientMethods):
    """A service, for programs with an event loop; see `Client`."""

    _http_client = httpx.AsyncClient

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def job(self, prompts: Sequence[str], form: str = "npz", **options: Any) -> AsyncJob:
        """Has motions made in the background."""
        return AsyncJob(self, await self._new_job(prompts, form, options))

    @asynccontextmanager
    async def stream(
        self, prompt: str, seed: int = 0, **options: Any
    ) -> AsyncIterator[AsyncStream]:
        """Opens an endless motion: iterate over its pieces, call `say` to change what is done."""
        from websockets.asyncio.client import connect

        address, arguments = _socket(self._http)
        with _told_stream(address):
            async with connect(address, **arguments) as socket:
                await socket.send(json.dumps({"prompt": prompt, "seed": seed, **_given(options)}))
                yield AsyncStream(socket)


class JobMethods:
    """The methods of `Job`, and of `AsyncJob`, where they are awaited."""

    def __init__(self, client: ClientMethods, name: str) -> None:
        self._client, self._http, self.name = client, client._http, name

    @_Method
    def state(self) -> Flow[dict[str, Any]]:
        """Returns how far it is: state, motions, made, error."""
        return (yield from self._client._answer("GET", f"/v1/jobs/{self.name}")).json()

    @_Method
    def result(self, timeout: float = 3600.0) -> Flow[bytes]:
        """Waits for the file and returns it.

        Raises:
            ServiceError: The job failed, or is not done in time.
        """
        end = time.monotonic() + timeout
        while (yield from JobMethods.state(self))["state"] in UNDONE and time.monotonic() < end:
            yield 0.5
        return (yield from self._client._answer("GET", f"/v1/jobs/{self.name}/result")).content

    @_Method
    def delete(self) -> Flow[None]:
        """Ends it and removes its files."""
        yield from self._client._answer("DELETE", f"/v1/jobs/{self.name}")


class Job(_Blocking, JobMethods):
    """A job of a service, made by `Client.job`."""


class AsyncJob(_Awaited, JobMethods):
    """A job of a service, made by `AsyncClient.job`."""


class _Pieces:
    """Messages of a stream to motions."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._skeleton, self._fps, self._number, self._prompt = HUMANML3D, 20.0, 0, ""

    def _read(self, message: str | bytes) -> Motion | None:
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

    def _acknowledgement(self) -> str:
        """Returns the message that asks for one piece more."""
        return json.dumps({"ack": self._number})


class Stream(_Pieces):
    """An endless motion: an iterator of its pieces, each of some seconds."""

    def __iter__(self) -> Iterator[Motion]:
        return self

    def __next__(self) -> Motion:
        while (motion := self._read(self._socket.recv())) is None:
            pass
        self._socket.send(self._acknowledgement())
        return motion

    def say(self, prompt: str) -> None:
        """Changes what the person does, some pieces from now."""
        self._socket.send(json.dumps({"prompt": prompt}))


class AsyncStream(_Pieces):
    """An endless motion: an asynchronous iterator of its pieces, each of some seconds."""

    def __aiter__(self) -> AsyncIterator[Motion]:
        return self

    async def __anext__(self) -> Motion:
        while (motion := self._read(await self._socket.recv())) is None:
            pass
        await self._socket.send(self._acknowledgement())
        return motion

    async def say(self, prompt: str) -> None:
        """Changes what the person does, some pieces from now."""
        await self._socket.send(json.dumps({"prompt": prompt}))


def read_motions(content: bytes) -> list[Motion]:
    """Returns the motions of an `.npz` answer.

    Raises:
        FileFormatError: It is damaged.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "answer.npz"
        file.write_bytes(content)
        return formats.load(file)


def _retry_after(outcome: Outcome) -> float | None:
    """Returns for how many seconds a busy service wants to be left alone, if it says so."""
    if not isinstance(outcome, httpx.Response) or outcome.status_code not in BUSY:
        return None
    after = outcome.headers.get("Retry-After", "")
    return min(float(after), LONGEST_WAIT) if after.isdecimal() else None


def _lost(outcome: Outcome, repeatable: bool) -> bool:
    """Returns whether a call did not arrive, or may arrive twice and was not answered."""
    if isinstance(outcome, httpx.Response):
        return repeatable and outcome.status_code in LOST
    # A connection that was refused has carried nothing.
    lost = httpx.NetworkError | httpx.RemoteProtocolError
    return isinstance(outcome, lost if repeatable else httpx.ConnectError)


def _checked(outcome: Outcome, url: object) -> httpx.Response:
    """Raises LatentMotionError for an answer that is none, or where none came."""
    if not isinstance(outcome, httpx.Response):
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


def _socket(http: Any) -> tuple[str, dict[str, Any]]:
    """Returns the address of the stream, and the arguments of its connection."""
    address = str(http.base_url).rstrip("/").replace("http", "ws", 1) + "/v1/stream"
    token = http.headers.get("Authorization")
    headers = {"Authorization": token} if token else {}
    return address, {"additional_headers": headers, "max_size": LARGEST_PIECE}


@contextmanager
def _told_stream(address: str) -> Iterator[None]:
    """Raises LatentMotionError where the connection fails or ends."""
    from websockets.exceptions import WebSocketException

    try:
        yield
    except (OSError, WebSocketException) as error:
        raise LatentMotionError(f"the stream of {address} ended: {error}") from error
