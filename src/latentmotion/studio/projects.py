"""Routes of projects and characters: what a user works on, and the figures that motions are put on.

A project is one JSON file in a folder of the library. Of a character it is kept which of its bones
are our joints.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unicodedata import normalize

from fastapi import APIRouter, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, Response
from pydantic import ValidationError

from latentmotion.errors import InputError
from latentmotion.formats import MEDIA_TYPES
from latentmotion.service.state import Service, unless_gone
from latentmotion.service.uploads import BINARY_BODY, uploaded
from latentmotion.storage import configuration, reading
from latentmotion.storage.files import write_file
from latentmotion.studio.library import Library, UnknownError
from latentmotion.studio.schemas import FileName, Id, MappingChange, Project, ProjectName


def routes(library: Library) -> APIRouter:
    """Returns the routes."""
    router = APIRouter(prefix="/projects")
    folder = library.folder / "projects"

    @router.get("")
    def listed() -> dict[str, list[dict[str, str]]]:
        """List projects, the one that was written last first."""
        files = [file for file in folder.glob("*.json") if not file.name.startswith(".")]
        times = sorted(((file.stat().st_mtime, file.stem) for file in files), reverse=True)
        return {
            "projects": [
                {"name": name, "changed": datetime.fromtimestamp(at, UTC).isoformat()}
                for at, name in times
            ]
        }

    @router.get("/{name}")
    def shown(name: ProjectName) -> Project:
        """Send a project."""
        path = _file(folder, name)
        content = configuration.read_plain(path)
        form = content.get("format", 1) if isinstance(content, dict) else 1
        if form != 1:
            raise InputError(
                f"{path} is a project of format {form!r}, expected 1: a later version of Latent "
                "Motion wrote it; update this one"
            )
        try:
            return Project.model_validate(content)
        except ValidationError as error:
            location = ".".join(map(str, error.errors()[0]["loc"]))
            raise InputError(
                f"{path}: {location}: {error.errors()[0]['msg']}; correct it"
            ) from error

    @router.put("/{name}")
    def kept(name: ProjectName, project: Project) -> Project:
        """Write a project, in place of the one of this name."""
        named = project.model_copy(update={"name": name})
        write(folder, name, named.model_dump())
        return named

    @router.delete("/{name}")
    def removed(name: ProjectName) -> dict[str, Any]:
        """Remove a project; the answer holds it, so that it can be put back."""
        project = shown(name)
        _file(folder, name).unlink()
        return {"removed": project}

    return router


def write(folder: Path, name: str, project: Mapping[str, Any]) -> None:
    """Writes a project.

    Args:
        folder: The folder of projects.
        name: Name of the project.
        project: Content of the project.

    Raises:
        InputError: Some systems cannot have a file of this name, or would put it in place of
            another, or the project holds what JSON cannot.
    """
    if name.upper() in _RESERVED:
        raise InputError(f"{name!r} is a device of Windows, not a file; choose another name")
    # As macOS and Windows compare names: in any case, and however accents are encoded.
    key = normalize("NFC", name).casefold()
    stems = [file.stem for file in folder.glob("*.json")]
    alike = [stem for stem in stems if normalize("NFC", stem).casefold() == key]
    if alike and name not in alike:
        raise InputError(
            f"{name!r} and the project {alike[0]!r} are one file on macOS and Windows; choose "
            "another name, or that one"
        )
    try:
        text = json.dumps(project, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        content = text.encode()
    except (ValueError, RecursionError) as error:  # NaN, halves of characters, deep nesting
        raise InputError(f"this project cannot be written as JSON: {error}") from error
    reading.parse_json(text, f"project {name!r}")  # what could not be read again is told now
    write_file(folder / f"{name}.json", content)


# Names that Windows keeps for devices.
_RESERVED = frozenset(
    {"CON", "PRN", "AUX", "NUL"} | {f"{port}{n}" for port in ("COM", "LPT") for n in range(10)}
)


def _file(folder: Path, name: str) -> Path:
    """Returns the file of a project.

    Raises:
        UnknownError: There is none of this name.
    """
    path = folder / f"{name}.json"
    if not path.is_file():
        raise UnknownError(f"there is no project {name!r} in this library")
    return path


# Endings of characters, and those under which they are kept: VRM is GLB by another name.
ENDINGS: Mapping[str, str] = {".glb": "glb", ".vrm": "glb", ".bvh": "bvh"}


def character_routes(service: Service, library: Library) -> APIRouter:
    """Returns the routes of characters."""
    router = APIRouter(prefix="/characters")

    @router.get("")
    def listed(deleted: bool = False) -> dict[str, Any]:
        """List characters, the newest first."""
        return {"characters": [character.about() for character in library.characters(deleted)]}

    @router.post("", openapi_extra=BINARY_BODY)
    async def added(request: Request, name: FileName) -> dict[str, Any]:
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

    @router.get("/{name}")
    def shown(name: Id) -> dict[str, Any]:
        """Describe a character."""
        return library.character(name).about()

    @router.get("/{name}/model", response_class=FileResponse)
    def model(name: Id) -> Response:
        """Send the figure at rest, as it was uploaded."""
        file = library.character_file(library.character(name))
        if not file.is_file():
            raise InputError(f"the file of this character, {file}, is gone; open it again")
        return FileResponse(file, media_type=MEDIA_TYPES[file.suffix[1:]])

    @router.patch("/{name}")
    async def changed(request: Request, name: Id, change: MappingChange) -> dict[str, Any]:
        """Correct which bone is which joint; what is left out has none."""
        character = await run_in_threadpool(library.character, name)
        mapping = {ours: bone for ours, bone in change.mapping.items() if bone is not None}
        file = library.character_file(character).resolve()
        task = {"folder": str(file.parent), "file": file.name, "map": mapping}
        bones = await _inspected(service, request, task)
        return (await run_in_threadpool(library.change_character, name, bones=bones)).about()

    @router.delete("/{name}")
    def deleted(name: Id) -> dict[str, Any]:
        """Mark a character as deleted; `restore` takes the mark away."""
        return library.change_character(name, deleted=True).about()

    @router.post("/{name}/restore")
    def restored(name: Id) -> dict[str, Any]:
        """Take the mark of a deleted character away."""
        return library.change_character(name, deleted=False).about()

    return router


async def _inspected(service: Service, request: Request, task: dict[str, Any]) -> dict[str, Any]:
    """Returns what a worker process reports of a character's bones."""
    head = await unless_gone(request, service.read({"verb": "rig", **task}))
    return {key: value for key, value in head.items() if key != "size"}
