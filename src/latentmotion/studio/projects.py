"""Projects: what a user works on, one JSON file each in a folder of the library."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unicodedata import normalize

from fastapi import APIRouter
from pydantic import ValidationError

from latentmotion.errors import InputError
from latentmotion.storage.configuration import read_plain
from latentmotion.storage.files import atomic_file
from latentmotion.storage.reading import parse_json
from latentmotion.studio.library import Library, UnknownError
from latentmotion.studio.schemas import Project, ProjectName


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
        content = read_plain(path)
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
        text = json.dumps(project, indent=1, ensure_ascii=False, allow_nan=False)
        content = f"{text}\n".encode()
    except (ValueError, RecursionError) as error:  # NaN, halves of characters, deep nesting
        raise InputError(f"this project cannot be written as JSON: {error}") from error
    parse_json(text, f"project {name!r}")  # what could not be read again is told now
    with atomic_file(folder / f"{name}.json") as temporary:
        temporary.write_bytes(content)


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
