"""Routes for files of users: clean up, convert, retarget. A file is read by a worker process."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import Response, StreamingResponse

from latentmotion import formats
from latentmotion.service import schemas
from latentmotion.service.problems import Problem
from latentmotion.service.state import Service, unless_gone

Fps = Annotated[float | None, Query(ge=1, le=240, allow_inf_nan=False)]
Source = Annotated[schemas.Readable, Query(description="Format of the body.")]
Target = Annotated[schemas.FileFormat, Query(alias="format", description="Format of the answer.")]

_FILE = {"schema": {"type": "string", "format": "binary"}}
# OpenAPI schema of a body that is a file.
BINARY_BODY = {"requestBody": {"required": True, "content": {"application/octet-stream": _FILE}}}


def clean_up_steps(
    smooth: bool = True,
    bones: bool = True,
    floor: bool = True,
    feet: bool = True,
    in_place: bool = False,
    cutoff: Annotated[float, Query(gt=0, le=100, allow_inf_nan=False)] = 5.0,
) -> dict[str, Any]:
    """Returns the clean-up settings in the query of a request."""
    return locals()


def routes(service: Service) -> APIRouter:
    """Returns the routes."""
    router = APIRouter(prefix="/v1", tags=["files"])

    @router.post("/clean", openapi_extra=BINARY_BODY, response_class=Response)
    async def clean(
        request: Request,
        source: Source,
        steps: Annotated[dict[str, Any], Depends(clean_up_steps)],
        target: Target = "glb",
        fps: Fps = None,
    ) -> Response:
        """Clean up the motions of a file: hold standing feet, put the figure on the floor."""
        return await _convert(service, request, source, target, {"clean": steps, "fps": fps})

    @router.post("/convert", openapi_extra=BINARY_BODY, response_class=Response)
    async def convert(
        request: Request, source: Source, target: Target = "glb", fps: Fps = None
    ) -> Response:
        """Write the motions of a file in another format."""
        return await _convert(service, request, source, target, {"clean": None, "fps": fps})

    @router.post("/retarget", openapi_extra=BINARY_BODY, response_class=Response)
    async def retarget(
        request: Request,
        source: Annotated[
            schemas.Character, Query(description="Format of the character, the body.")
        ],
        prompt: Annotated[str, Query(max_length=schemas.MOST_CHARACTERS)],
        target: Annotated[Literal["glb", "bvh"], Query(alias="format")] = "glb",
        seconds: Annotated[float | None, Query(allow_inf_nan=False)] = None,
        seed: Annotated[int, Query(ge=0, lt=2**53)] = 0,
        steps: Annotated[int | None, Query(ge=1, le=schemas.MOST_STEPS)] = None,
        guidance: Annotated[float | None, Query(allow_inf_nan=False)] = None,
        clean: bool = True,
        fps: Fps = None,
    ) -> Response:
        """Generate a motion and put it on the character in the body."""
        motion_request = schemas.MotionRequest(
            prompt=prompt, seconds=seconds, seed=seed, steps=steps, guidance=guidance, clean=clean
        )
        async with uploaded(service, request, f"character.{source}") as folder:
            until = service.deadline()
            raw, dirty = await unless_gone(request, service.motion(motion_request, until))
            content, _ = await service.file([raw], "npz", dirty, None, until)
            (folder / "motion.npz").write_bytes(content)
            task = {"verb": "retarget", "file": f"character.{source}", "format": target}
            return await _answer(service, request, folder, {**task, "fps": fps})

    return router


async def _convert(
    service: Service, request: Request, source: str, target: str, options: dict[str, Any]
) -> Response:
    formats.check_ending(f"motion.{target}") if target not in ("json", "viewer") else None
    async with uploaded(service, request, f"motion.{source}") as folder:
        task = {"verb": "convert", "file": f"motion.{source}", "format": target, **options}
        return await _answer(service, request, folder, task)


@asynccontextmanager
async def uploaded(service: Service, request: Request, name: str) -> AsyncIterator[Path]:
    """Yields a folder in which the body is a file, and removes it in the end.

    Raises:
        Problem: No work is taken at the moment, or the body is empty.
    """
    service.check_ready()
    folder = Path(tempfile.mkdtemp(prefix="latentmotion-"))
    try:
        size = 0
        with (folder / name).open("wb") as file:
            async for piece in request.stream():
                size += file.write(piece)
        if not size:
            raise Problem(422, "the body is empty; expected the file")
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


async def _answer(
    service: Service, request: Request, folder: Path, task: dict[str, Any]
) -> Response:
    head = await unless_gone(request, service.read({**task, "folder": str(folder)}))
    return file_response(folder / "answer", f"motion.{head['format']}")


def file_response(path: Path, name: str) -> StreamingResponse:
    """Returns an answer with a file, which may be deleted before all of it is sent.

    Args:
        path: The file.
        name: Its name for the client, whose ending is one of `MEDIA_TYPES`.
    """
    file = path.open("rb")  # now, not when the first piece is sent

    def pieces() -> Iterator[bytes]:
        with file:
            while piece := file.read(1 << 16):
                yield piece

    headers = {
        "Content-Disposition": f'attachment; filename="{name}"',
        "Content-Length": str(path.stat().st_size),
    }
    media_type = formats.MEDIA_TYPES[name.partition(".")[2]]
    return StreamingResponse(pieces(), headers=headers, media_type=media_type)
