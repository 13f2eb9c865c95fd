"""The application of the studio: the service's, with the page and the routes of the library."""

from __future__ import annotations

import asyncio
import sqlite3
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.responses import Response

from latentmotion.service.app import Extension, asset_files, create_app, page_routes
from latentmotion.service.problems import FULL_DISK, problem_response
from latentmotion.service.settings import Settings
from latentmotion.service.state import Service
from latentmotion.studio import characters, models, projects, session, takes
from latentmotion.studio.library import Library, MissingMotionError, UnknownError

POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; connect-src 'self' blob:; "
    "worker-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""Content security policy: files of the studio; images and models that the user opens."""


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
    extension = Extension(
        partial(_routes, library, files, others),
        frozenset({"/studio", "/studio/"} | named),
        frozenset({"/studio/v1/import", "/studio/v1/characters"}),
    )
    layers = (*settings.middleware, session.CookieToken)
    app = create_app(replace(settings, middleware=layers), extension)
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
        characters.routes(service, library),
        projects.routes(library),
        session.routes(),
        takes.best_routes(library, offered),
        takes.teaching_routes(library, offered),
    ):
        router.include_router(routes, prefix="/studio/v1", tags=["studio"])
    return router
