"""Client of a service (`latentmotion serve`), for programs that have no model.

    from latentmotion.client import Client

    with Client("http://localhost:8700", token) as service:
        motion = service.motion("a person walks forward and sits down", seconds=4, seed=7)
        motion.save("sit.bvh")

Needs `pip install "latentmotion[client]"`. A service that is busy is asked again, as long as its
answers say when; so is one whose connection is refused or lost, a few times. A program with an
event loop calls it in a thread: `await asyncio.to_thread(service.motion, "a person walks")`.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
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
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._http = httpx.Client(
            base_url=url, headers=headers, timeout=timeout, transport=transport
        )
        self._patience = patience

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def motion(self, prompt: str, seconds: float | None = None, **options: Any) -> Motion:
        """Returns a motion.

        Args:
            prompt: What the person does.
            seconds: Length; by default as predicted.
            options: seed, steps, guidance, sampler, clean, fps, goals, headings, path, as the
                service's OpenAPI has them.
        """
        return self._motions(prompt=prompt, seconds=seconds, **options)[0]

    def file(self, prompt: str, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion as a file: glb, bvh, npz, csv, usdz, html, json or raw."""
        return self._content("/v1/motions", prompt=prompt, format=form, **options)

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
        pairs = [(span, None) if isinstance(span, str) else span for span in spans]
        keys = "part", "prompt", "start", "end"
        options |= {
            "timeline": [{"prompt": prompt, "seconds": seconds} for prompt, seconds in pairs],
            "timeline_parts": [dict(zip(keys, part, strict=True)) for part in parts],
        }
        return self._motions(**options)[0]

    def batch(self, prompts: Sequence[str], **options: Any) -> list[Motion]:
        """Returns several motions."""
        return self._motions("/v1/batches", prompts=list(prompts), **options)

    def clean(self, file: str | Path, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion file cleaned up."""
        return self._from_file("clean", file, format=form, **options)

    def convert(self, file: str | Path, form: str = "glb", **options: Any) -> bytes:
        """Returns a motion file in another format."""
        return self._from_file("convert", file, format=form, **options)

    def retarget(
        self, character: str | Path, prompt: str, form: str = "glb", **options: Any
    ) -> bytes:
        """Returns a character file with a motion."""
        return self._from_file("retarget", character, format=form, prompt=prompt, **options)

    def models(self) -> list[dict[str, Any]]:
        """Returns what the service's models are."""
        return self._answer("GET", "/v1/models").json()

    def job(self, prompts: Sequence[str], form: str = "npz", **options: Any) -> Job:
        """Has motions made in the background."""
        body = {"prompts": list(prompts), "format": form, **_given(options)}
        # The service keeps no other: a new job must not arrive twice.
        return Job(self, self._answer("POST", "/v1/jobs", False, json=body).json()["id"])

    @contextmanager
    def stream(self, prompt: str, seed: int = 0, **options: Any) -> Iterator[Stream]:
        """Opens an endless motion: iterate over its pieces, call `say` to change what is done."""
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect

        address = str(self._http.base_url).rstrip("/").replace("http", "ws", 1) + "/v1/stream"
        token = self._http.headers.get("Authorization")
        headers = {"Authorization": token} if token else {}
        try:
            with connect(address, additional_headers=headers, max_size=LARGEST_PIECE) as socket:
                socket.send(json.dumps({"prompt": prompt, "seed": seed, **_given(options)}))
                yield Stream(socket)
        except (OSError, WebSocketException) as error:
            raise LatentMotionError(f"the stream of {address} ended: {error}") from error

    def _content(self, path: str, **body: Any) -> bytes:
        return self._answer("POST", path, json=_given(body)).content

    def _motions(self, path: str = "/v1/motions", **body: Any) -> list[Motion]:
        return read_motions(self._content(path, format="npz", **body))

    def _from_file(self, verb: str, file: str | Path, **query: Any) -> bytes:
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
        return self._answer("POST", f"/v1/{verb}", **sent).content

    def _answer(
        self, method: str, path: str, repeatable: bool = True, **sent: Any
    ) -> httpx.Response:
        """Sends a request, again where the service is busy or was not reached.

        Args:
            method: Method of HTTP.
            path: Path below the address of the service.
            repeatable: Whether the request may arrive twice.
            sent: Content and parameters, as httpx takes them.
        """
        end, lost = time.monotonic() + self._patience, 0
        while True:
            try:
                outcome = self._http.request(method, path, **sent)
            except httpx.HTTPError as error:
                outcome = error
            after = ""  # for how many seconds a busy service wants to be left alone
            if isinstance(outcome, httpx.Response):
                is_lost = repeatable and outcome.status_code in LOST
                if outcome.status_code in BUSY:
                    after = outcome.headers.get("Retry-After", "")
            else:  # a connection that was refused has carried nothing
                kinds = httpx.NetworkError | httpx.RemoteProtocolError
                is_lost = isinstance(outcome, kinds if repeatable else httpx.ConnectError)
            pause = min(float(after), LONGEST_WAIT) if after.isdecimal() else None
            if pause is None and lost < RECONNECTS and is_lost:
                pause = PAUSE * 2**lost
                lost += 1
            if pause is None or time.monotonic() + pause >= end:
                break
            time.sleep(pause)
        if isinstance(outcome, httpx.HTTPError):
            problem = f"no service at {self._http.base_url}: {outcome or type(outcome).__name__}"
            raise LatentMotionError(problem) from outcome
        if outcome.is_success:
            return outcome
        try:
            detail = str(outcome.json()["detail"])
        except (ValueError, KeyError, TypeError):
            detail = outcome.text[:200] or outcome.reason_phrase
        raise ServiceError(outcome.status_code, detail)


class Job:
    """A job of a service, made by `Client.job`."""

    def __init__(self, client: Client, name: str) -> None:
        self._client, self.name = client, name

    def state(self) -> dict[str, Any]:
        """Returns how far it is: state, motions, finished, error."""
        return self._client._answer("GET", f"/v1/jobs/{self.name}").json()

    def result(self, timeout: float = 3600.0) -> bytes:
        """Waits for the file and returns it.

        Raises:
            ServiceError: The job failed, or is not done in time.
        """
        end = time.monotonic() + timeout
        while self.state()["state"] in UNDONE and time.monotonic() < end:
            time.sleep(0.5)
        return self._client._answer("GET", f"/v1/jobs/{self.name}/result").content

    def delete(self) -> None:
        """Ends it and removes its files."""
        self._client._answer("DELETE", f"/v1/jobs/{self.name}")


class Stream:
    """An endless motion: an iterator of its pieces, each of some seconds."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._skeleton, self._fps, self._number, self._prompt = HUMANML3D, 20.0, 0, ""

    def __iter__(self) -> Iterator[Motion]:
        return self

    def __next__(self) -> Motion:
        while isinstance(message := self._socket.recv(), str):
            # What the service says of the stream, or of the piece that follows.
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
        joints = np.frombuffer(message, "<f4").reshape(-1, len(self._skeleton), 3)
        self._socket.send(json.dumps({"ack": self._number}))  # asks for one piece more
        return Motion(joints, self._fps, self._skeleton, self._prompt)

    def say(self, prompt: str) -> None:
        """Changes what the person does, some pieces from now."""
        self._socket.send(json.dumps({"prompt": prompt}))


def read_motions(content: bytes) -> list[Motion]:
    """Returns the motions of an `.npz` answer.

    Raises:
        FileFormatError: It is damaged.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "answer.npz"
        file.write_bytes(content)
        return formats.load(file)


def _given(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}
