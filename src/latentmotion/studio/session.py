"""Sessions: one token for each library, and the cookie that replaces it in the browser.

The address that the command prints holds the token behind `#`, which no server, log or other page
sees. The page sends it once and is given a cookie, so that every tab, bookmark and restart of the
studio in this browser is let in.
"""

from __future__ import annotations

import html
import os
import secrets
from http.cookies import SimpleCookie
from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import Response
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from latentmotion.errors import InputError
from latentmotion.service.settings import LEAST_TOKEN

COOKIE = "latentmotion-studio"
"""Name of the cookie, before the port: browsers share cookies between the ports of a host."""

COOKIE_SECONDS = 365 * 24 * 3600
"""How long a browser keeps the cookie."""

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
                token = SimpleCookie(headers["cookie"]).get(_name(headers))
                if token is not None:
                    bearer = f"Bearer {token.value}".encode("latin-1", "replace")
                    scope = {**scope, "headers": [*scope["headers"], (b"authorization", bearer)]}
        await self.app(scope, receive, send)


def routes() -> APIRouter:
    """Returns the route that gives a browser its cookie."""
    router = APIRouter()

    @router.post("/session", status_code=204, response_class=Response)
    async def opened(request: Request) -> Response:
        """Let this browser in: the token of this request becomes a cookie of all its tabs."""
        answer = Response(status_code=204)
        token = request.headers.get("authorization", "").partition(" ")[2].strip()
        age = {"max_age": COOKIE_SECONDS, "path": "/", "httponly": True}
        answer.set_cookie(_name(request.headers), token, **age, samesite="strict")
        return answer

    return router


def _name(headers: Headers) -> str:
    port = headers.get("host", "").rpartition(":")[2]
    return f"{COOKIE}-{port}" if port.isdecimal() else COOKIE
