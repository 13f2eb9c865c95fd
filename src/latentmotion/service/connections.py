"""Connections: headers must arrive in time, and idle connections make room for new ones."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

HEAD_SECONDS = 10.0
"""Time from the opening of a connection, or the first byte of a further request, to the end of the
request's head."""

CONNECTIONS = 1000
"""Requests under way at the same time; beyond, they are answered by 503."""

CONNECTIONS_OF_ADDRESS = CONNECTIONS // 2
"""Most connections of one address, so that a single client cannot take all of them."""

SPARE = 24
"""Connections beyond these limits, on which health checks are still answered."""

HEALTH = frozenset({"/livez", "/readyz"})
"""Paths of health checks."""


class Connection(HttpToolsProtocol):
    """A connection of HTTP; of too many, the one that has been silent longest is closed."""

    _head: asyncio.TimerHandle | None = None
    _is_stream = False

    def connection_made(self, transport: Any) -> None:
        """Expects a request."""
        super().connection_made(transport)
        self.silent_since = self.loop.time()
        self._expect_head()
        self._make_room()

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

    def _make_room(self) -> None:
        """Closes a silent connection where this address, or all together, have too many."""
        everyone: list[Any] = list(self.connections)
        same_address = [
            peer for peer in everyone if peer.client and peer.client[0] == (self.client or "?")[0]
        ]
        for crowd, most in ((same_address, CONNECTIONS_OF_ADDRESS), (everyone, CONNECTIONS)):
            if len(crowd) > most + SPARE:
                idle = [peer for peer in crowd if peer.is_idle and peer is not self]
                last = min(
                    idle,
                    key=lambda peer: (peer.cycle is not None, peer.silent_since),
                    default=self,
                )
                last.transport.abort()
                return
