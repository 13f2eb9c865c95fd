"""Routes of takes: made, listed, changed, shown, written to files."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response

from latentmotion.service.answers import MEDIA_TYPES
from latentmotion.service.problems import Problem
from latentmotion.service.schemas import FileFormat
from latentmotion.service.state import Service, unless_gone
from latentmotion.service.uploads import Fps
from latentmotion.studio.library import MOST_LISTED, Library, Take, UnknownError
from latentmotion.studio.making import Maker, digest_of_model
from latentmotion.studio.schemas import (
    AgainAnswer,
    ListAnswer,
    TakeAnswer,
    TakeChanges,
    TakeId,
    TakesAnswer,
    TakesRequest,
)

_EDITS = ("trim", "speed", "in_place", "mirrored")


def routes(service: Service, library: Library) -> APIRouter:
    """Returns the routes."""
    router = APIRouter()
    maker = Maker(service.pipeline, digest_of_model(service.settings.model), library)

    @router.post("/takes", response_model=TakesAnswer)
    async def make(request: Request, wanted: TakesRequest) -> Any:
        """Make takes of a recipe and keep them."""
        service.check_ready()
        work = partial(maker.made, wanted.recipe, wanted.takes)
        made = await unless_gone(request, service.called(work, service.settings.deadline))
        found = await run_in_threadpool(library.add, made)
        return {"takes": [take.about() for take in found]}

    @router.get("/takes", response_model=ListAnswer)
    def listed(
        query: Annotated[str, Query(max_length=500)] = "",
        tag: Annotated[str, Query(max_length=50)] = "",
        star: bool | None = None,
        deleted: bool = False,
        offset: Annotated[int, Query(ge=0, lt=2**53)] = 0,
        limit: Annotated[int, Query(ge=1, le=MOST_LISTED)] = 100,
    ) -> Any:
        """List takes, the newest first."""
        total, found = library.takes(query, tag, star, deleted, offset, limit)
        return {"total": total, "takes": [take.about() for take in found]}

    @router.get("/takes/{name}", response_model=TakeAnswer)
    def shown(name: TakeId) -> Any:
        """Describe a take."""
        return _known(library, name).about()

    @router.patch("/takes/{name}", response_model=TakeAnswer)
    def changed(name: TakeId, wanted: TakeChanges) -> Any:
        """Change title, tags, star or edits of a take."""
        take, found = _known(library, name), wanted.model_dump(include=wanted.model_fields_set)
        edits = {key: found.pop(key) for key in _EDITS if key in found}
        if "tags" in found:
            found["tags"] = tuple(found["tags"])
        return library.change(name, edits=replace(take.edits, **edits), **found).about()

    @router.delete("/takes/{name}", response_model=TakeAnswer)
    def deleted(name: TakeId) -> Any:
        """Mark a take as deleted; `restore` takes the mark away."""
        _known(library, name)
        return library.change(name, deleted=True).about()

    @router.post("/takes/{name}/restore", response_model=TakeAnswer)
    def restored(name: TakeId) -> Any:
        """Take the mark of a deleted take away."""
        _known(library, name)
        return library.change(name, deleted=False).about()

    @router.post("/takes/{name}/again", response_model=AgainAnswer)
    async def again(request: Request, name: TakeId) -> Any:
        """Make a take again from its recipe, and compare; a missing file is written again."""
        service.check_ready()
        take = await run_in_threadpool(_known, library, name)
        work = partial(maker.again, take.recipe)
        motion = await unless_gone(request, service.called(work, service.settings.deadline))
        equal, back = await run_in_threadpool(library.compare, take, motion)
        return {"equal": equal, "restored": back}

    @router.get("/takes/{name}/joints", response_class=Response)
    def joints(name: TakeId) -> Response:
        """Send the joints of a take as float32, little-endian: frames × joints × 3, meters."""
        motion = library.motion(_known(library, name))
        headers = {"X-Frames": str(len(motion)), "X-Fps": f"{motion.fps:.17g}"}
        content = motion.joints.astype("<f4").tobytes()
        return Response(content, headers=headers, media_type="application/octet-stream")

    @router.get("/takes/{name}/viewer", response_class=Response)
    async def viewer(name: TakeId) -> Response:
        """Send what the viewer reads."""
        return await _file(service, library, name, "viewer", None)

    @router.get("/takes/{name}/file", response_class=Response)
    async def file(
        name: TakeId,
        form: Annotated[FileFormat, Query(alias="format")] = "glb",
        fps: Fps = None,
    ) -> Response:
        """Send a take as a file, edited as it is shown."""
        return await _file(service, library, name, form, fps)

    return router


def file_name(take: Take, ending: str) -> str:
    """Returns the name of a take's file: words of its title, and its number."""
    words = re.sub("[^a-z0-9]+", "-", take.title.lower())[:60].strip("-")
    return f"{words or 'take'}-{take.id[-6:].lower()}.{ending}"


def _known(library: Library, name: str) -> Take:
    """Returns a take.

    Raises:
        Problem: 404, there is none of this name.
    """
    try:
        return library.take(name)
    except UnknownError as error:
        raise Problem(404, str(error)) from error


async def _file(
    service: Service,
    library: Library,
    name: str,
    form: FileFormat | Literal["viewer"],
    fps: float | None,
) -> Response:
    take = await run_in_threadpool(_known, library, name)
    motion = await run_in_threadpool(library.motion, take)
    content, found = await service.file([motion], form, False, fps)
    headers = {"Content-Disposition": f'attachment; filename="{file_name(take, found)}"'}
    return Response(content, headers=headers, media_type=MEDIA_TYPES[found])
