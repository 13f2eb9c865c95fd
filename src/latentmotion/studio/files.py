"""Takes as files: edited as they are shown, in any format, on a character if wanted."""

from __future__ import annotations

import re
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from fastapi.concurrency import run_in_threadpool

from latentmotion.errors import InputError
from latentmotion.formats.content import encoded
from latentmotion.service.state import Service
from latentmotion.studio.library import Library, Take

CHARACTER_FORMATS = ["glb", "bvh"]
"""Formats of characters."""


@dataclass(frozen=True)
class Written:
    """How takes are written."""

    format: str
    """Format of the service."""
    fps: float | None = None
    """Frames per second; by default the take's own."""
    character: str | None = None
    """Name of the character; by default the mannequin of the format."""

    def check(self) -> None:
        """Raises InputError if characters cannot be written in the format."""
        if self.character is not None and self.format not in CHARACTER_FORMATS:
            known = " or ".join(CHARACTER_FORMATS)
            raise InputError(f"format {self.format}: characters are written as {known}")


async def content_of(
    service: Service, library: Library, take: Take, wanted: Written
) -> tuple[bytes, str]:
    """Returns a take as a file's content, and the file's ending.

    Raises:
        LatentMotionError: The motion or the character cannot be used, or not written so.
        Problem: Too much waits, or it took too long.
    """
    wanted.check()
    motion = await run_in_threadpool(library.motion, take)
    if wanted.character is None:
        return await service.file([motion], wanted.format, False, wanted.fps, service.deadline())
    character = await run_in_threadpool(library.character, wanted.character)
    task = {
        **{"verb": "retarget", "map": character.joint_map(), "figure": True},
        **{"file": str(library.character_file(character).resolve()), "format": wanted.format},
    }
    with tempfile.TemporaryDirectory(prefix="latentmotion-") as folder:
        own, _ = await run_in_threadpool(encoded, [motion], "npz")
        (Path(folder) / "motion.npz").write_bytes(own)
        head = await service.read({**task, "folder": folder, "fps": wanted.fps})
        return (Path(folder) / "answer").read_bytes(), head["format"]


async def archived(
    service: Service, library: Library, takes: list[Take], wanted: Written, path: Path
) -> None:
    """Writes takes as a zip archive of a file each.

    Raises:
        LatentMotionError: As `content_of`.
        Problem: Likewise.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for take in takes:
            content, ending = await content_of(service, library, take, wanted)
            await run_in_threadpool(archive.writestr, file_name(take, ending), content)


def file_name(take: Take, ending: str) -> str:
    """Returns the name of a take's file: words of its title, and its number."""
    words = re.sub("[^a-z0-9]+", "-", take.title.lower())[:60].strip("-")
    return f"{words or 'take'}-{take.id[-6:].lower()}.{ending}"
