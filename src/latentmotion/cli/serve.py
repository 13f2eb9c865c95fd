"""`latentmotion serve`, `studio`, `mcp`, `mmcp`: a model for programs, people and agents.

What serves is imported when a command runs: each needs an extra, which `main` names if it lacks.
"""

from __future__ import annotations

import hashlib
import math
import webbrowser
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import Annotated, Any

from tyro.conf import UseAppendAction, arg

from latentmotion.cli import options
from latentmotion.errors import InputError
from latentmotion.model.card import DEFAULT
from latentmotion.pipeline import MotionPipeline
from latentmotion.service import settings as service

ModelName = Annotated[str, arg(help="Name or folder of an exported model.")]


@dataclass(frozen=True, kw_only=True)
class _Listening:
    """Options of both servers over HTTP that read a model once and run it for all requests."""

    host: str = "127.0.0.1"
    """Address to listen at; by default only this machine is let in."""
    hosts: tuple[str, ...] = ()
    """Names by which clients may call; by default those of this machine, or, where other machines
    are let in, any."""
    moves: options.Moves = ()
    runtime: options.Runtime = "auto"
    """Engine of the networks; a model that was not exported cannot be served."""

    def _settings(self, **others: Any) -> service.Settings:
        if self.runtime == "pytorch":
            raise InputError("--runtime pytorch cannot be served; export the model first")
        hosts = self.hosts or (service.LOOPBACK if self.host in service.LOOPBACK else ())
        moves = tuple(path.resolve() for path in self.moves)
        return service.Settings(runtime=self.runtime, moves=moves, hosts=hosts, **others)


@dataclass(frozen=True, kw_only=True)
class Serve(service.ServiceOptions, _Listening):
    """Serve motions over HTTP and WebSocket: a page at /, an interface for programs at /v1.

    Example: latentmotion serve --port 8700, then open http://localhost:8700
    """

    port: int = 8700
    """Port to listen at; 0 for any free one."""
    token_file: Path | None = None
    """File of the tokens that are let in, one per line: as they are, or sha256: and 64 hex
    digits."""
    insecure: bool = False
    """Let other machines in without tokens."""
    allow_origin: tuple[str, ...] = ()
    """Origins of web pages on other hosts that may call, such as https://example.com."""
    batch_size: int = 16
    """Motions that are generated together at most."""
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
        """
        for name, seconds in (("notice", self.notice), ("shutdown", self.shutdown)):
            if not (math.isfinite(seconds) and 0 <= seconds <= 3600):
                raise InputError(f"--{name} {seconds:g}: expected 0 to 3600 seconds")
        settings = self._settings(
            **options.values_for(service.ServiceOptions, self),
            batch=self.batch_size,
            tokens=service.read_tokens(self.token_file) if self.token_file else (),
            origins=self.allow_origin,
            middleware=tuple(map(_middleware_named, self.asgi_middleware)),
        )
        service.check_bind(self.host, settings, self.insecure)
        from latentmotion.service.app import create_app
        from latentmotion.service.server import address, bound, serve

        with bound(self.host, self.port) as listener:
            app = create_app(settings)
            print(address(listener), flush=True)
            serve(app, listener, self.notice, self.shutdown)


def _middleware_named(name: str) -> service.Middleware:
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


@dataclass(frozen=True)
class Studio(_Listening):
    """Make, direct, compare and export motions on a page of this machine.

    Example: latentmotion studio --library my_motions
    """

    model: UseAppendAction[tuple[str, ...]] = ()
    """Name or folder of an exported model, fast by default; given several times, the page offers
    them all, and those that ship, and starts with the first."""
    port: int = 8765
    """Port to listen at; 0 for any free one."""
    library: Path | None = None
    """Folder of takes, characters and projects; by default one in the user's folder for data."""
    browser: bool = True
    """Open the page in the browser."""
    deadline: float = 120.0
    """Seconds that a request may take."""

    def run(self) -> None:
        """Serves until SIGTERM or Ctrl+C.

        Raises:
            InputError: An option cannot be used, the address is taken, or the folder is none.
        """
        settings = self._settings(
            model=(self.model or (DEFAULT,))[0],
            deadline=self.deadline,
            file_workers=1,
            start_workers=True,
        )
        from latentmotion.service.server import address, bound, serve
        from latentmotion.studio.app import create_studio, kept_token, redirecting_page
        from latentmotion.studio.library import Library, default_folder

        with bound(self.host, self.port) as listener:
            library = Library((self.library or default_folder()).expanduser().resolve())
            token = kept_token(library.folder)
            settings = replace(settings, tokens=(hashlib.sha256(token.encode()).digest(),))
            app = create_studio(settings, library, self.model[1:])
            # Behind #, so that neither a log nor another page ever sees it; a browser is started
            # with a file that leads there, so that no list of processes has it either.
            page = f"{address(listener)}/studio#token={token}"
            print(page, flush=True)
            if self.browser:  # in a thread, since a browser of the terminal holds the server up
                local_page = redirecting_page(library.folder, page).as_uri()
                Thread(target=webbrowser.open, args=(local_page,), daemon=True).start()
            serve(app, listener, 0.0, 5.0)


@dataclass(frozen=True)
class Mcp:
    """Serve an agent over MCP: generate, direct, describe, search, retarget, render.

    Without --port the agent's program starts this command and speaks to it over standard input
    and output: claude mcp add motion -- latentmotion mcp --folder motions
    """

    folder: Path = Path()
    """The only folder whose files the agent's tools read and write."""
    port: int | None = None
    """Port to listen at on this machine, over HTTP at /mcp."""
    model: ModelName = DEFAULT
    threads: options.Threads = None

    def run(self) -> None:
        """Serves until the agent's program goes, or Ctrl+C.

        Raises:
            InputError: There is no such folder.
        """
        if not self.folder.is_dir():
            raise InputError(f"there is no folder {self.folder}; make it first")
        from latentmotion.service.mcp import server

        pipeline = MotionPipeline.from_pretrained(self.model, threads=self.threads)
        ready = server(pipeline, self.folder)
        if self.port is None:
            ready.run("stdio")
        else:
            print(f"http://127.0.0.1:{self.port}/mcp", flush=True)
            ready.run("streamable-http", host="127.0.0.1", port=self.port)


@dataclass(frozen=True)
class Mmcp:
    """Serve animation programs over MMCP, such as Proscenium for Blender.

    Example: latentmotion mmcp, then http://localhost:8000 as the server in the add-on
    """

    port: int = 8000
    """Port to listen at on this machine."""
    model: ModelName = DEFAULT
    threads: options.Threads = None

    def run(self) -> None:
        """Serves until Ctrl+C."""
        import uvicorn

        from latentmotion.service.mmcp import application

        app = application(MotionPipeline.from_pretrained(self.model, threads=self.threads))
        print(f"http://localhost:{self.port}", flush=True)
        uvicorn.run(app, host="127.0.0.1", port=self.port, log_level="warning")
