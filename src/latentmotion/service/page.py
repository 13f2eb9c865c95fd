"""The pages `/` (a prompt and the viewer) and `/docs`: nothing inline, nothing from other hosts."""

from __future__ import annotations

from importlib import resources

from fastapi import APIRouter, Request
from fastapi.responses import Response

from latentmotion.service.problems import Problem
from latentmotion.viewer import page as viewer

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
"""Content security policy of the page: files of this service alone."""


def routes() -> APIRouter:
    """Returns the routes of the page and its files."""
    router = APIRouter(include_in_schema=False)
    frame, style = viewer.split_page("/assets/viewer.css", "/assets/show.js")
    files = {name: _asset(name).encode() for name in ("page.css", "page.js", "docs.js", "show.js")}
    files |= {"viewer.css": style.encode(), "viewer.js": viewer.script().encode()}
    pages = {"/": _asset("page.html").encode(), "/viewer": frame.encode()}
    pages["/docs"] = _asset("docs.html").encode()

    @router.get("/")
    @router.get("/docs")
    @router.get("/viewer")
    async def page(request: Request) -> Response:
        """Send a page."""
        headers = {"Content-Security-Policy": POLICY}
        return Response(pages[request.url.path], headers=headers, media_type="text/html")

    @router.get("/assets/{name}")
    async def asset(name: str) -> Response:
        """Send a file of a page."""
        if name not in files:
            raise Problem(404, f"there is no file {name[:100]!r}")
        kind = "text/css" if name.endswith(".css") else "text/javascript"
        headers = {"Cache-Control": "no-cache"}
        return Response(files[name], headers=headers, media_type=kind)

    return router


def _asset(name: str) -> str:
    folder = resources.files("latentmotion.service").joinpath("assets")
    return folder.joinpath(name).read_text(encoding="utf-8")
