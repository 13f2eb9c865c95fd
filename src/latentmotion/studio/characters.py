"""Routes of characters: figures of the user, and which of their bones are our joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, Response

from latentmotion.errors import InputError
from latentmotion.formats.content import MEDIA_TYPES
from latentmotion.service.state import Service, unless_gone
from latentmotion.service.uploads import BINARY_BODY, uploaded
from latentmotion.studio.library import Library
from latentmotion.studio.schemas import (
    CharacterAnswer,
    CharactersAnswer,
    FileName,
    Id,
    MappingChange,
)

ENDINGS: Mapping[str, str] = {".glb": "glb", ".vrm": "glb", ".bvh": "bvh"}
"""Endings of characters, and those under which they are kept: VRM is GLB by another name."""


def routes(service: Service, library: Library) -> APIRouter:
    """Returns the routes."""
    router = APIRouter(prefix="/characters")

    @router.get("", response_model=CharactersAnswer)
    def listed(deleted: bool = False) -> Any:
        """List characters, the newest first."""
        return {"characters": [character.about() for character in library.characters(deleted)]}

    @router.post("", response_model=CharacterAnswer, openapi_extra=BINARY_BODY)
    async def added(request: Request, name: FileName) -> Any:
        """Keep a character, GLB, VRM or BVH, and find its bones."""
        ending = ENDINGS.get(Path(name).suffix.lower())
        if ending is None:
            endings = ", ".join(ENDINGS)
            raise InputError(f"{name!r} is no character that can be read; expected {endings}")
        async with uploaded(service, request, f"character.{ending}") as folder:
            file = f"character.{ending}"
            with (folder / file).open("rb") as opened:
                is_glb = opened.read(4) == b"glTF"
            if ending == "glb" and not is_glb:
                raise InputError(
                    f"{name!r} is no binary glTF, whatever its name says; export it as .glb or .vrm"
                )
            bones = await _inspected(service, request, {"folder": str(folder), "file": file})
            character = await run_in_threadpool(library.add_character, name, folder / file, bones)
        return character.about()

    @router.get("/{name}", response_model=CharacterAnswer)
    def shown(name: Id) -> Any:
        """Describe a character."""
        return library.character(name).about()

    @router.get("/{name}/model", response_class=FileResponse)
    def model(name: Id) -> Response:
        """Send the figure at rest, as it was uploaded."""
        file = library.character_file(library.character(name))
        if not file.is_file():
            raise InputError(f"the file of this character, {file}, is gone; open it again")
        return FileResponse(file, media_type=MEDIA_TYPES[file.suffix[1:]])

    @router.patch("/{name}", response_model=CharacterAnswer)
    async def changed(request: Request, name: Id, change: MappingChange) -> Any:
        """Correct which bone is which joint; what is left out has none."""
        character = await run_in_threadpool(library.character, name)
        mapping = {ours: bone for ours, bone in change.mapping.items() if bone is not None}
        file = library.character_file(character).resolve()
        task = {"folder": str(file.parent), "file": file.name, "map": mapping}
        bones = await _inspected(service, request, task)
        return (await run_in_threadpool(library.change_character, name, bones=bones)).about()

    @router.delete("/{name}", response_model=CharacterAnswer)
    def deleted(name: Id) -> Any:
        """Mark a character as deleted; `restore` takes the mark away."""
        return library.change_character(name, deleted=True).about()

    @router.post("/{name}/restore", response_model=CharacterAnswer)
    def restored(name: Id) -> Any:
        """Take the mark of a deleted character away."""
        return library.change_character(name, deleted=False).about()

    return router


async def _inspected(service: Service, request: Request, task: dict[str, Any]) -> dict[str, Any]:
    """Returns what a worker process reports of a character's bones."""
    head = await unless_gone(request, service.read({"verb": "rig", **task}))
    return {key: value for key, value in head.items() if key != "size"}
