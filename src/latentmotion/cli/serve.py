"""`latentmotion serve`: the service over HTTP and WebSocket."""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import UseAppendAction, arg

from latentmotion.cli import options
from latentmotion.errors import InputError, MissingExtraError
from latentmotion.model.card import DEFAULT

if TYPE_CHECKING:
    from latentmotion.service.settings import Middleware

ExportedRuntime = Annotated[options.Runtime, arg(help="Engine of the networks.")]


@dataclass(frozen=True)
class Serve:
    """Serve motions over HTTP and WebSocket: a page at /, an interface for programs at /v1.

    Example: latentmotion serve --port 8700, then open http://localhost:8700
    """

    host: str = "127.0.0.1"
    """Address to listen at; by default only this machine is let in."""
    port: int = 8700
    """Port to listen at; 0 for any free one."""
    token_file: Path | None = None
    """File of the tokens that are let in, one per line: as they are, or sha256: and 64 hex
    digits."""
    insecure: bool = False
    """Let other machines in without tokens."""
    hosts: tuple[str, ...] = ()
    """Names by which clients may call; by default those of this machine, or, where other machines
    are let in, any."""
    allow_origin: tuple[str, ...] = ()
    """Origins of web pages on other hosts that may call, such as https://example.com."""
    model: str = DEFAULT
    """Name or folder of an exported model."""
    moves: options.Moves = ()
    runtime: options.Runtime = "auto"
    """Engine of the networks; a model that was not exported cannot be served."""
    threads: Annotated[int, arg(help="Threads that run the model, each a batch of its own.")] = 1
    batch_size: int = 16
    """Motions that are generated together at most."""
    queue: int = 64
    """Motions that wait at most; beyond, requests are refused (429)."""
    deadline: float = 30.0
    """Seconds that a request may take."""
    file_workers: int = 2
    """Processes that clean up motions and write files; as many again read uploads."""
    upload: int = 64
    """Megabytes of an uploaded file at most."""
    streams: int = 32
    """Streams that are open at the same time at most."""
    jobs: Path | None = None
    """Folder of jobs, kept when the service stops; replicas may share it."""
    notice: float = 0.0
    """Seconds at SIGTERM between saying so at /readyz and stopping; a balancer needs some."""
    shutdown: float = 30.0
    """Seconds at SIGTERM in which what waits is finished."""
    asgi_middleware: UseAppendAction[tuple[str, ...]] = ()
    """ASGI middleware around the service, MODULE:CALLABLE, such as OpenTelemetry's."""

    def run(self) -> None:
        """Serves until SIGTERM or Ctrl+C.

        Raises:
            InputError: An option cannot be used, or the address is taken.
            MissingExtraError: FastAPI and what it needs are not installed.
        """
        from latentmotion.service.settings import LOOPBACK, Settings, check_bind, read_tokens

        if self.runtime == "pytorch":
            raise InputError("--runtime pytorch cannot be served; export the model first")
        for name, seconds in (("notice", self.notice), ("shutdown", self.shutdown)):
            if not (math.isfinite(seconds) and 0 <= seconds <= 3600):
                raise InputError(f"--{name} {seconds:g}: expected 0 to 3600 seconds")
        settings = Settings(
            model=self.model,
            moves=tuple(path.resolve() for path in self.moves),
            runtime=self.runtime,
            threads=self.threads,
            queue=self.queue,
            batch=self.batch_size,
            deadline=self.deadline,
            file_workers=self.file_workers,
            jobs=self.jobs,
            streams=self.streams,
            upload=self.upload,
            tokens=read_tokens(self.token_file) if self.token_file else (),
            hosts=self.hosts or (LOOPBACK if self.host in LOOPBACK else ()),
            origins=self.allow_origin,
            middleware=tuple(map(middleware_named, self.asgi_middleware)),
        )
        check_bind(self.host, settings, self.insecure)
        try:
            from latentmotion.service.app import create_app
            from latentmotion.service.server import address, bound, serve
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith("latentmotion"):
                raise
            raise MissingExtraError("latentmotion serve", error.name, "serve") from error
        with bound(self.host, self.port) as listener:
            app = create_app(settings)
            print(address(listener), flush=True)
            serve(app, listener, self.notice, self.shutdown)


def middleware_named(name: str) -> Middleware:
    """Imports ASGI middleware.

    Raises:
        InputError: It is not MODULE:CALLABLE, or there is none.
    """
    module, colon, function = name.partition(":")
    if not (module and colon and function):
        raise InputError(f"--asgi-middleware {name}: expected MODULE:CALLABLE")
    try:
        middleware = getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise InputError(f"--asgi-middleware {name}: {error}") from error
    if not callable(middleware):
        raise InputError(f"--asgi-middleware {name}: it cannot be called")
    return middleware
