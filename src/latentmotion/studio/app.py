"""The application of the studio: the service's, with the page and the routes of the library.

Sessions: one token for each library, and the cookie that replaces it in the browser.

The address that the command prints holds the token behind `#`, which no server, log or other page
sees. The page sends it once and is given a cookie, so that every tab, bookmark and restart of the
studio in this browser is let in.
"""

from __future__ import annotations

import asyncio
import html
import os
import secrets
import sqlite3
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import Response
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from latentmotion.errors import InputError
from latentmotion.service.app import asset_files, create_app, page_routes
from latentmotion.service.problems import FULL_DISK, problem_response
from latentmotion.service.settings import LEAST_TOKEN, Settings
from latentmotion.service.state import Service
from latentmotion.studio import models, projects, takes
from latentmotion.studio.library import Library, MissingMotionError, UnknownError

# Name of the cookie, before the port: browsers share cookies between the ports of a host.
COOKIE = "latentmotion-studio"

COOKIE_SECONDS = 365 * 24 * 3600  # How long a browser keeps the cookie.

# Values of Sec-Fetch-Site with which the cookie counts; older browsers send no such header.
_OWN_PAGES = ("same-origin", "none", None)


def kept_token(folder: Path) -> str:
    """Returns the token of a library; a new one where there is none, or others could have read it.

    Args:
        folder: The library. The token is in its file `token`, which only its owner can read.

    Raises:
        InputError: The file cannot be read or written.
    """
    path = folder / "token"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if path.is_file() and (os.name == "nt" or not path.stat().st_mode & 0o077):
            token = path.read_text(encoding="ascii", errors="replace").strip()
            if len(token) >= LEAST_TOKEN and token.isascii():
                return token
        token = secrets.token_urlsafe(32)
        _write_private(path, token + "\n")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); the studio keeps its token there; "
            "name another folder by --library"
        ) from error
    return token


def redirecting_page(folder: Path, address: str) -> Path:
    """Writes a page that only its owner can read, and that leads a browser to an address.

    The words that start a browser can be read by everybody on this machine, so that they name this
    file in place of an address with a token.

    Args:
        folder: The library.
        address: The address, with its token.
    """
    path = folder / "open.html"
    target = html.escape(address)
    _write_private(
        path,
        '<!doctype html><meta charset="utf-8"><title>Latent Motion studio</title>\n'
        f'<meta http-equiv="refresh" content="0; url={target}">\n'
        f'<p>The studio is at <a href="{target}">this address</a>.</p>\n',
    )
    return path


def _write_private(path: Path, text: str) -> None:
    """Writes a file anew that only its owner can read."""
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(text)


class CookieToken:
    """An ASGI layer that reads the token from the cookie where a request has no other.

    Args:
        app: The application that checks the token.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Passes the request on."""
        if scope["type"] in ("http", "websocket"):
            headers = Headers(scope=scope)
            is_own = headers.get("sec-fetch-site") in _OWN_PAGES
            if is_own and "authorization" not in headers and "cookie" in headers:
                token = SimpleCookie(headers["cookie"]).get(_cookie_name(headers))
                if token is not None:
                    bearer = f"Bearer {token.value}".encode("latin-1", "replace")
                    scope = {**scope, "headers": [*scope["headers"], (b"authorization", bearer)]}
        await self.app(scope, receive, send)


def _cookie_name(headers: Headers) -> str:
    port = headers.get("host", "").rpartition(":")[2]
    return f"{COOKIE}-{port}" if port.isdecimal() else COOKIE


# Content security policy: files of the studio; images and models that the user opens.
POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; connect-src 'self' blob:; "
    "worker-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


def create_studio(settings: Settings, library: Library, others: Sequence[str] = ()) -> FastAPI:
    """Returns the application.

    Args:
        settings: Settings of the service, tokens included.
        library: Library of takes; closed with the application.
        others: Names, folders or hub ids of models that the page offers as well.

    Raises:
        InputError: A model moves another skeleton than the first.
        ModelError: There is no such model.
    """
    files = asset_files("latentmotion.studio")
    named = {f"/studio/assets/{name}" for name in files}
    app = create_app(
        replace(settings, middleware=(*settings.middleware, CookieToken)),
        partial(_routes, library, files, others),
        frozenset({"/studio", "/studio/"} | named),
        frozenset({"/studio/v1/import", "/studio/v1/characters"}),
    )
    app.add_exception_handler(UnknownError, partial(_on_error, 404))
    app.add_exception_handler(MissingMotionError, partial(_on_error, 410))
    app.add_exception_handler(sqlite3.Error, _on_database)
    return app


async def _on_error(status: int, request: Request, error: Exception) -> Response:
    return problem_response(status, str(error))


async def _on_database(request: Request, error: Exception) -> Response:
    """Answers what SQLite says; its error is written down for the owner of the studio."""
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
    print(f"error: library.sqlite3: {error}", file=sys.stderr)
    if code == sqlite3.SQLITE_FULL:
        return problem_response(507, FULL_DISK, {"Retry-After": "60"})
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        detail = "another program is writing to the library; try again"
        return problem_response(503, detail, {"Retry-After": "5"})
    detail = f"the library's database cannot be used ({error}); close the studio and repair it"
    return problem_response(503, detail, {"Retry-After": "60"})


def _routes(
    library: Library, files: dict[str, bytes], others: Sequence[str], service: Service
) -> APIRouter:
    offered = models.Models(service, library, others)

    @asynccontextmanager
    async def lifespan(app: Any) -> AsyncIterator[None]:
        # Takes half a second the first time: done before the page asks.
        description = asyncio.create_task(asyncio.to_thread(models.described, offered))
        yield
        await asyncio.gather(description, return_exceptions=True)
        library.close()

    router = APIRouter(lifespan=lifespan)

    @router.post("/studio/v1/session", status_code=204, response_class=Response, tags=["studio"])
    async def opened(request: Request) -> Response:
        """Let this browser in: the token of this request becomes a cookie of all its tabs."""
        answer = Response(status_code=204)
        token = request.headers.get("authorization", "").partition(" ")[2].strip()
        age = {"max_age": COOKIE_SECONDS, "path": "/", "httponly": True}
        answer.set_cookie(_cookie_name(request.headers), token, **age, samesite="strict")
        return answer

    page = files["index.html"]
    pages = {"/studio": page, "/studio/": page}
    policy = {"Content-Security-Policy": POLICY}  # of the page's workers, too
    router.include_router(page_routes(pages, files, "/studio/assets", POLICY, **policy))
    for routes in (
        models.routes(offered),
        takes.recipe_routes(service, library, offered),
        takes.routes(library),
        takes.file_routes(service, library),
        takes.transfer_routes(service, library),
        projects.character_routes(service, library),
        projects.routes(library),
        takes.model_routes(library, offered),
    ):
        router.include_router(routes, prefix="/studio/v1", tags=["studio"])
    return router
