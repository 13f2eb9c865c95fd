"""Takes as files: with their edits, in any format, on a character if one is named."""

from __future__ import annotations

import re
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from fastapi.concurrency import run_in_threadpool

from latentmotion.errors import InputError
from latentmotion.formats.content import encoded
from latentmotion.pipeline import RawMotion
from latentmotion.service.state import Service
from latentmotion.studio.library import Library, StoredTake

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
            formats = " or ".join(CHARACTER_FORMATS)
            raise InputError(f"format {self.format}: characters are written as {formats}")


async def content_of(
    service: Service, library: Library, take: StoredTake, form: Written
) -> tuple[bytes, str]:
    """Returns a take as a file's content, and the file's ending.

    Raises:
        LatentMotionError: The motion or the character cannot be used, or not written so.
        Problem: Too much waits, or it took too long.
    """
    form.check()
    motion = await run_in_threadpool(library.motion, take)
    if form.character is None:
        raw = [RawMotion(motion)]
        return await service.file(raw, form.format, False, form.fps, service.deadline())
    character = await run_in_threadpool(library.character, form.character)
    task = {
        **{"verb": "retarget", "map": character.joint_map(), "figure": True},
        **{"file": str(library.character_file(character).resolve()), "format": form.format},
    }
    with tempfile.TemporaryDirectory(prefix="latentmotion-") as folder:
        motion_file, _ = await run_in_threadpool(encoded, [motion], "npz")
        (Path(folder) / "motion.npz").write_bytes(motion_file)
        head = await service.read({**task, "folder": folder, "fps": form.fps})
        return (Path(folder) / "answer").read_bytes(), head["format"]


async def archived(
    service: Service, library: Library, takes: list[StoredTake], form: Written, path: Path
) -> None:
    """Writes takes as a zip archive of a file each.

    Raises:
        LatentMotionError: As `content_of`.
        Problem: Likewise.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for take in takes:
            content, ending = await content_of(service, library, take, form)
            await run_in_threadpool(archive.writestr, file_name(take, ending), content)


def file_name(take: StoredTake, ending: str) -> str:
    """Returns the name of a take's file: words of its title, and its number."""
    words = re.sub("[^a-z0-9]+", "-", take.title.lower())[:60].strip("-")
    return f"{words or 'take'}-{take.id[-6:].lower()}.{ending}"
