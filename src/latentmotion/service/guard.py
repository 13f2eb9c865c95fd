"""The guard: an ASGI layer that lets a request in by host, token and size, and counts it.

It runs on the event loop alone, so that it answers however busy the model is.
"""

from __future__ import annotations

import asyncio
import hashlib
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from latentmotion.service.batching import CLIENT
from latentmotion.service.problems import Problem, problem_response, refuse_stream
from latentmotion.service.settings import CONNECTIONS, CONNECTIONS_OF_ADDRESS
from latentmotion.service.state import Service

# Paths that need no token: they hold nothing of anyone.
OPEN = frozenset(
    {"/", "/docs", "/viewer", "/livez", "/readyz", "/openapi.json"}
    | {f"/assets/{name}.js" for name in ("page", "docs", "show", "viewer")}
    | {f"/assets/{name}.css" for name in ("page", "viewer")}
)

UPLOADS = frozenset({"/v1/clean", "/v1/convert", "/v1/retarget"})  # Paths whose bodies are files.

# Paths that are refused before the body is read while the queue is full.
QUEUED = frozenset({"/v1/motions", "/v1/batches"})

HEALTH = frozenset({"/livez", "/readyz"})  # Paths of health checks.

LARGEST_BODY = 1 << 18  # Largest request body that is no file, bytes.

BODY_SECONDS = 10.0  # Time until when a body has to be there; a file has six times as long.

# Headers of every answer that has none of the kind.
SECURITY: Mapping[str, str] = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'; sandbox",
}


class Guard:
    """The layer.

    Args:
        app: The application behind the guard.
        service: The service, for its settings and the room in its queue.
        open_paths: Paths that need no token.
        uploads: Paths whose bodies are files.
    """

    def __init__(
        self,
        app: ASGIApp,
        service: Service,
        open_paths: frozenset[str] = OPEN,
        uploads: frozenset[str] = UPLOADS,
    ) -> None:
        self.app, self.service = app, service
        self.settings, self.metrics = service.settings, service.metrics
        self._open, self._uploads = open_paths, uploads
        self._under_way = Counter[str]()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers with a problem, or passes the request on."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] == "websocket":
            try:
                self._check(scope)
            except Problem as problem:
                await receive()
                await refuse_stream(problem, scope, receive, send)
            else:
                await self.app(scope, receive, send)
            return
        # 499 is nginx' status for a client that left before an answer began.
        began, status = time.monotonic(), 499

        async def counted(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(raw=message["headers"])
                for name, value in SECURITY.items():
                    headers.setdefault(name, value)
                if self.service.leaving:  # so that nothing is sent on it when it is closed
                    headers["Connection"] = "close"
            await send(message)

        address = (scope.get("client") or ("",))[0]
        self._under_way[address] += 1
        try:
            self._check(scope)
            here, everywhere = self._under_way[address], self._under_way.total()
            crowded = here > CONNECTIONS_OF_ADDRESS or everywhere > CONNECTIONS
            if crowded and scope["path"] not in HEALTH:
                detail = f"{here} requests of {address} are under way; try again later"
                raise Problem(503, detail, 1.0)
            receive = self._bounded(scope, receive)
            # Before the body is read, so that a refused request costs next to nothing.
            if scope["path"] in QUEUED and scope["method"] == "POST":
                self.service.batcher.check_room(1, self.settings.deadline)
        except Problem as problem:
            headers = dict(problem.headers or {})
            if problem.status_code != 429:  # who is told to come back keeps the connection
                headers["Connection"] = "close"
            refuse = problem_response(problem.status_code, str(problem.detail), headers)
            await refuse(scope, receive, counted)
        else:
            with self.metrics.open.track_inprogress():
                await self.app(scope, receive, counted)
        finally:
            self._under_way[address] -= 1
            self._under_way += Counter()  # drops addresses that have none
        counted_as = scope["path"] if scope["path"] in QUEUED else "other"
        route = getattr(scope.get("route"), "path", counted_as)
        self.metrics.requests.labels(route, status).inc()
        self.metrics.request_seconds.labels(route).observe(time.monotonic() - began)

    def _check(self, scope: Scope) -> None:
        """Checks host, origin and token.

        Raises:
            Problem: 403 or 401.
        """
        headers, settings = Headers(scope=scope), self.settings
        host = headers.get("host", "")
        name = host.strip().lower()
        if not name.startswith("["):
            name = name.partition(":")[0]  # without the port
        elif not (port := name.partition("]")[2]) or port.startswith(":"):
            name = name[1:].partition("]")[0]
        # Another host is a name that somebody bound to this address (DNS rebinding).
        if settings.hosts and name not in settings.hosts:
            detail = f"host {host[:100]!r} is not served; call one of {', '.join(settings.hosts)}"
            raise Problem(403, f"{detail}, or start the service with --hosts")
        origin = headers.get("origin")
        # Browsers send the origin: pages of other sites must not use a service on their reader's
        # machine.
        place = ""  # the host and port of the origin; "null" has none
        with suppress(ValueError):
            place = urlsplit(origin or "").netloc.lower()
        allowed = origin in settings.origins
        if origin is not None and not allowed and place != host.lower():
            allow = "start the service with --allow-origin to let them"
            raise Problem(403, f"pages of {origin[:100]!r} may not call this service; {allow}")
        if not settings.tokens or scope["path"] in self._open:
            return
        kind, _, token = headers.get("authorization", "").partition(" ")
        if kind.lower() != "bearer" or not settings.knows(token.strip()):
            reason = "this token is not known" if token else "no token"
            problem = Problem(401, f"{reason}; send the header Authorization: Bearer TOKEN")
            problem.headers = {"WWW-Authenticate": 'Bearer realm="latentmotion"'}
            raise problem
        if len(settings.tokens) > 1:
            # A hash, since the name of the client is written to the disk beside its jobs.
            CLIENT.set(hashlib.sha256(token.strip().encode()).hexdigest())

    def _bounded(self, scope: Scope, receive: Receive) -> Receive:
        """Returns `receive`, which ends bodies that are too large or too slow.

        Raises:
            Problem: 413, the body says that it is too large.
        """
        upload = scope["path"] in self._uploads
        most = self.settings.upload << 20 if upload else LARGEST_BODY
        large = Problem(413, f"the body has more than {most:,} bytes; send less")
        length = Headers(scope=scope).get("content-length", "0")
        # 18 digits fit into 64 bits; Python would parse millions of them.
        if not length.isdecimal() or len(length) > 18 or int(length) > most:
            raise large
        until = time.monotonic() + BODY_SECONDS * (6 if upload else 1)
        size, whole = 0, False

        async def bounded() -> Message:
            nonlocal size, whole
            if whole:
                return await receive()
            try:
                async with asyncio.timeout(until - time.monotonic()):
                    message = await receive()
            except TimeoutError:
                raise Problem(408, "the body did not arrive in time; send it faster") from None
            size += len(message.get("body", b""))
            whole = not message.get("more_body", False)
            if size > most:
                raise large
            return message

        return bounded
