"""The application: routes of the service, with OpenAPI; `create_app` makes it.

from latentmotion.service.app import create_app
from latentmotion.service.settings import Settings

app = create_app(Settings(queue=128))
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from importlib import resources
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import Response
from starlette.exceptions import HTTPException
from starlette.middleware.cors import CORSMiddleware

from latentmotion import __version__
from latentmotion.errors import LatentMotionError
from latentmotion.formats import MEDIA_TYPES
from latentmotion.motion import Motion
from latentmotion.service import metrics, problems, streams, uploads
from latentmotion.service.guard import OPEN, UPLOADS, Guard
from latentmotion.service.jobs import Jobs
from latentmotion.service.jobs import routes as job_routes
from latentmotion.service.schemas import BatchRequest, ModelAnswer, MotionRequest
from latentmotion.service.settings import Settings
from latentmotion.service.state import DRAINING, ClientGoneError, Service, about, unless_gone
from latentmotion.viewer import page as viewer

_PROBLEMS: dict[int | str, dict[str, Any]] = {
    status: {"description": about, "content": {problems.MEDIA_TYPE: {}}}
    for status, about in {
        400: "The body is not JSON.",
        401: "The token is missing or not known.",
        403: "This host or this page may not call.",
        408: "The body took too long.",
        413: "The body is too large.",
        422: "What is asked for cannot be made; the text says why.",
        429: "The queue is full; Retry-After says when to try again.",
        503: "Loading, shutting down or too late; Retry-After says when to try again.",
        507: "The disk of the service is full.",
    }.items()
}
_MOTIONS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The motion, in the format that was asked for.",
        "content": {kind.partition(";")[0]: {} for kind in MEDIA_TYPES.values()},
    }
}


# Content security policy of the page: files of this service alone.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)


# Kinds of files that pages may name, by their endings.
ASSETS: Mapping[str, str] = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".woff2": "font/woff2",
    ".txt": "text/plain",
}


def create_app(
    settings: Settings | None = None,
    extension: Callable[[Service], APIRouter] | None = None,
    open_paths: frozenset[str] = frozenset(),
    upload_paths: frozenset[str] = frozenset(),
) -> FastAPI:
    """Returns the application, which starts its threads and processes when it is served.

    Args:
        settings: Settings of the service; by default the shipped model for this machine alone.
        extension: Builds further routes, of an application on top of the service.
        open_paths: Those that need no token.
        upload_paths: Those whose request bodies are files.

    Raises:
        ModelError: There is no such model, or it was not exported.
    """
    service = Service(settings or Settings())
    jobs = Jobs(service, service.settings.jobs)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        # FastAPI builds a route when it is first asked for, with warnings turned off for the
        # process; now no other thread does the same, and no request waits for it.
        app.openapi()
        works = service.start(), service.watch(), jobs.work()
        tasks = [asyncio.create_task(work) for work in works]
        yield
        service.drain()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await service.stop()

    async def on_gone(request: Request, error: Exception) -> Response:
        service.metrics.dropped.inc()
        return Response(status_code=499)

    handlers = dict.fromkeys((HTTPException, LatentMotionError, OSError), problems.on_error)
    handlers |= {RequestValidationError: problems.on_fields, ClientGoneError: on_gone}
    app = FastAPI(
        title="Latent Motion",
        version=__version__,
        description="Sentences become 3D human motion.",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        responses=_PROBLEMS,
        exception_handlers={**handlers, Exception: problems.on_failure},
    )
    app.state.service = service
    for routes in (_health, _motions, uploads.routes, streams.routes):
        app.include_router(routes(service))
    app.include_router(job_routes(service, jobs))
    # `/` (a prompt and the viewer) and `/docs`, without anything inline.
    frame, style = viewer.split_page("/assets/viewer.css", "/assets/show.js")
    files = asset_files("latentmotion.service")
    files |= {"viewer.css": style.encode(), "viewer.js": viewer.script().encode()}
    pages = {"/": files.pop("page.html"), "/docs": files.pop("docs.html")}
    app.include_router(page_routes({**pages, "/viewer": frame.encode()}, files, "/assets", POLICY))
    if extension is not None:
        app.include_router(extension(service))
    allowed, uploaded = OPEN | open_paths, UPLOADS | upload_paths
    app.add_middleware(Guard, service=service, open_paths=allowed, uploads=uploaded)
    if service.settings.origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=service.settings.origins,
            allow_methods=("GET", "POST", "DELETE"),
            allow_headers=("Authorization", "Content-Type"),
            expose_headers=[*_ABOUT_MOTION, *_MORE_HEADERS],
        )
    # Starlette puts the layer that is added last outermost.
    for middleware in reversed(service.settings.middleware):
        app.add_middleware(middleware)
    return app


def _health(service: Service) -> APIRouter:
    router = APIRouter(tags=["health"])

    @router.get("/livez", response_class=Response)
    async def livez() -> Response:
        """The process runs."""
        return Response("ok\n", media_type="text/plain")

    @router.get("/readyz", response_class=Response)
    async def readyz() -> Response:
        """The model is loaded and the service is not shutting down."""
        service.check_ready()
        if service.leaving:
            raise problems.Problem(503, DRAINING)
        return Response("ok\n", media_type="text/plain")

    @router.get("/metrics", response_class=Response)
    async def get_metrics() -> Response:
        """Metrics in Prometheus' format."""
        return Response(service.metrics.text(), media_type=metrics.MEDIA_TYPE)

    return router


def _motions(service: Service) -> APIRouter:
    router = APIRouter(prefix="/v1", tags=["motions"])

    @router.post("/motions", responses=_MOTIONS, response_class=Response)
    async def motions(request: Request, body: MotionRequest) -> Response:
        """Generate a motion."""
        service.check_ready()

        async def generated() -> Response:
            until = service.deadline()
            with service.place(body.format, body.clean, body.fps):
                raw, dirty = await service.motion(body, until)
                file = service.file([raw], body.format, dirty, body.fps, until)
                return _response([raw.motion], *await file)

        return await unless_gone(request, generated())

    @router.post("/batches", responses=_MOTIONS, response_class=Response)
    async def batches(request: Request, body: BatchRequest) -> Response:
        """Generate several motions at once, as one file or a zip archive of several."""
        service.check_ready()

        async def generated() -> Response:
            until, settings = service.deadline(), body.settings()
            with service.place(body.format, body.clean, body.fps):
                seconds = service.settings.deadline
                raw = await service.generated(settings, body.all_prompts(), seconds)
                raw = body.to_clean(raw)
                file = service.file(raw, body.format, body.clean, body.fps, until)
                return _response([item.motion for item in raw], *await file)

        return await unless_gone(request, generated())

    @router.get("/models", responses={200: {"model": list[ModelAnswer]}})
    async def models() -> list[ModelAnswer]:
        """Describe the model that the service runs."""
        return [about(service.pipeline)]

    return router


def page_routes(
    pages: Mapping[str, bytes], files: Mapping[str, bytes], folder: str, policy: str, **asset: str
) -> APIRouter:
    """Returns routes of pages and of the files that they name, with nothing from other hosts.

    Args:
        pages: HTML by path.
        files: Content by name.
        folder: Path of the files.
        policy: Content security policy of the pages.
        asset: Headers of the files.
    """
    router = APIRouter(include_in_schema=False)

    async def page(request: Request) -> Response:
        """Send a page."""
        headers = {"Content-Security-Policy": policy}
        return Response(pages[request.url.path], headers=headers, media_type="text/html")

    for path in pages:
        router.add_api_route(path, page)

    @router.get(folder + "/{name}")
    async def file(name: str) -> Response:
        """Send a file of a page."""
        if name not in files:
            raise problems.Problem(404, f"there is no file {name[:100]!r}")
        headers = {"Cache-Control": "no-cache", **asset}
        return Response(files[name], headers=headers, media_type=ASSETS[Path(name).suffix])

    return router


def asset_files(package: str) -> dict[str, bytes]:
    """Returns the files in a package's folder `assets` that pages may name."""
    assets = resources.files(package).joinpath("assets").iterdir()
    files = [file for file in assets if file.is_file() and Path(file.name).suffix in ASSETS]
    return {file.name: file.read_bytes() for file in files}


# Headers with what the metadata of a motion say.
_ABOUT_MOTION = {
    "LatentMotion-Model": "model",
    "LatentMotion-License": "weights_license",
    "LatentMotion-Rights": "rights",
    "LatentMotion-Seed": "seed",
}

# Other headers that pages of other sites may read.
_MORE_HEADERS = ("LatentMotion-Frames", "LatentMotion-Fps", "Content-Disposition", "Retry-After")


def _response(motions: Sequence[Motion], content: bytes, form: str) -> Response:
    metadata = motions[0].metadata
    headers = {name: str(metadata.get(key, "")) for name, key in _ABOUT_MOTION.items()}
    headers["LatentMotion-Frames"] = ",".join(str(len(motion)) for motion in motions)
    headers["LatentMotion-Fps"] = f"{motions[0].fps:g}"
    headers["Content-Disposition"] = f'attachment; filename="motion.{form}"'
    safe = {name: value.encode("ascii", "replace").decode() for name, value in headers.items()}
    return Response(content, headers=safe, media_type=MEDIA_TYPES[form])
