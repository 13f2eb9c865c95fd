"""The server: uvicorn on one address, with a shutdown that loses nothing.

Heads of requests must arrive in time, and idle connections make room for new ones.
"""

from __future__ import annotations

import asyncio
import math
import select
import socket
import warnings
from contextlib import suppress
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from latentmotion.cleanup.pipeline import CleanUpWarning
from latentmotion.engine.encoder import UnknownWordsWarning
from latentmotion.errors import InputError
from latentmotion.retrieval.doubts import DoubtWarning
from latentmotion.service.settings import CONNECTIONS, CONNECTIONS_OF_ADDRESS
from latentmotion.storage.children import allow_open_files

# Time from the opening of a connection, or the first byte of a further request, to the end of the
# request's head.
HEAD_SECONDS = 10.0

SPARE = 24  # Connections beyond these limits, on which health checks are still answered.

# Seconds that an idle connection stays open: longer than a balancer's, which closes it first.
KEEP_ALIVE = 75

LARGEST_MESSAGE = 1 << 14  # Largest message of a stream's client, bytes.

WAITING = 2048  # Connections that may wait to be accepted (the backlog of the socket).

PASSES = 100  # Passes of the event loop at most in which the last connections are accepted.

QUIET = 0.5  # Seconds without a request after which the connections that are still open are closed.


class Connection(HttpToolsProtocol):
    """A connection of HTTP; of too many, the one that has been silent longest is closed."""

    _head: asyncio.TimerHandle | None = None
    _is_stream = False

    def connection_made(self, transport: Any) -> None:
        """Expects a request."""
        super().connection_made(transport)
        self.silent_since = self.loop.time()
        self._expect_head()
        # Of too many connections, of this address or all together, the one that has been silent
        # longest is closed.
        everyone: list[Any] = list(self.connections)
        same_address = [
            peer for peer in everyone if peer.client and peer.client[0] == (self.client or "?")[0]
        ]
        for crowd, most in ((same_address, CONNECTIONS_OF_ADDRESS), (everyone, CONNECTIONS)):
            if len(crowd) > most + SPARE:
                idle = [peer for peer in crowd if peer.is_idle and peer is not self]
                last = min(
                    idle, key=lambda peer: (peer.cycle is not None, peer.silent_since), default=self
                )
                last.transport.abort()
                return

    def data_received(self, data: bytes) -> None:
        """Reads a request, or a part of one."""
        super().data_received(data)
        if self._is_stream or not self.is_idle:
            self._stop_waiting()
        elif self._head is None and not self.transport.is_closing():
            self._expect_head()

    def handle_websocket_upgrade(self) -> None:
        """Hands the connection on to a stream."""
        super().handle_websocket_upgrade()
        self._is_stream = True

    def on_response_complete(self) -> None:
        """Waits for another request."""
        self.silent_since = self.loop.time()
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forgets the connection."""
        self._stop_waiting()
        super().connection_lost(exc)

    @property
    def is_idle(self) -> bool:
        """Whether no request is under way."""
        return self.cycle is None or self.cycle.response_complete

    def _expect_head(self) -> None:
        self._head = self.loop.call_later(HEAD_SECONDS, self.transport.close)

    def _stop_waiting(self) -> None:
        if self._head is not None:
            self._head.cancel()
            self._head = None


class Server(uvicorn.Server):
    """A server that tells its balancer before it stops.

    At SIGTERM `/readyz` says 503 at once; work is taken for some seconds more, until the balancer
    has seen it; then no connection is taken, and what waits is finished. From the signal on every
    answer has `Connection: close`; what comes on an open connection is answered until no work is
    left. A second signal ends the notice.

    Args:
        config: Settings of uvicorn.
        app: The application.
        notice: Seconds between saying so and stopping.
    """

    def __init__(self, config: uvicorn.Config, app: FastAPI, notice: float) -> None:
        super().__init__(config)
        self._service, self._notice = app.state.service, notice
        self._loop: asyncio.AbstractEventLoop | None = None

    async def serve(self, sockets: list[socket.socket] | None = None) -> None:
        """Serves until a signal ends it."""
        self._loop = asyncio.get_running_loop()
        await super().serve(sockets)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begins to shut down."""
        assert self._loop is not None
        if self._notice and not self._service.leaving:
            self._loop.call_soon_threadsafe(self._service.leave)
            later = self._loop.call_later
            self._loop.call_soon_threadsafe(later, self._notice, self.handle_exit, sig, frame)
            return
        self._loop.call_soon_threadsafe(self._service.drain)
        super().handle_exit(sig, frame)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Answers all that has come before it closes connections, in the time that there is."""
        loop = asyncio.get_running_loop()
        end = loop.time() + (self.config.timeout_graceful_shutdown or math.inf)
        with suppress(TimeoutError):
            async with asyncio.timeout_at(end):
                # Listening ends after the waiting connections are accepted, which closing would
                # reset: somebody who came is let in by the next two passes of the event loop.
                passes = 0
                for _ in range(PASSES):
                    passes = 0 if select.select(sockets or [], (), (), 0)[0] else passes + 1
                    if passes > 2:
                        break
                    await asyncio.sleep(0)
                for listener in [*self.servers, *(sockets or [])]:
                    listener.close()
                # Until no request is under way and none came for a while.
                state, answered = self.server_state, -1
                while not self.force_exit and (state.tasks or state.total_requests != answered):
                    answered = state.total_requests
                    await asyncio.sleep(QUIET)
        self.config.timeout_graceful_shutdown = max(0, math.ceil(end - loop.time()))
        await super().shutdown(sockets)


def bound(host: str, port: int) -> socket.socket:
    """Returns a socket that listens at an address.

    Raises:
        InputError: The address is taken, or not this machine's.
    """
    if not 0 <= port <= 65_535:
        raise InputError(f"--port {port}: expected 0 to 65535")
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return socket.create_server(address[:2], family=family, backlog=WAITING)
    except OSError as error:
        raise InputError(
            f"cannot serve at {host}:{port}: {error.strerror}; choose another --port or --host"
        ) from error


def address(listener: socket.socket) -> str:
    """Returns the address of a socket as browsers have it."""
    host, port = listener.getsockname()[:2]
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def serve(app: FastAPI, listener: socket.socket, notice: float, shutdown: float) -> None:
    """Serves until SIGTERM or Ctrl+C.

    Args:
        app: The application.
        listener: Socket to serve at.
        notice: Seconds between saying at `/readyz` that it stops, and stopping.
        shutdown: Seconds in which what waits is finished.
    """
    for category in (UnknownWordsWarning, DoubtWarning, CleanUpWarning):
        warnings.simplefilter("ignore", category)  # of users' prompts, which no log holds
    allow_open_files(4 * CONNECTIONS)  # a connection is an open file, of which 1,024 are usual
    Server(configuration(app, shutdown), app, notice).run([listener])


def configuration(app: FastAPI, shutdown: float) -> uvicorn.Config:
    """Returns the settings of uvicorn.

    Args:
        app: The application.
        shutdown: Seconds in which what waits is finished.
    """
    return uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        ws="websockets-sansio",
        ws_max_size=LARGEST_MESSAGE,
        ws_max_queue=16,
        ws_per_message_deflate=False,
        http=Connection,
        timeout_keep_alive=KEEP_ALIVE,
        timeout_graceful_shutdown=max(1, round(shutdown)),
    )
