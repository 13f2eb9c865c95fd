"""Motions as the content of a file: bytes in a requested format, and its media type."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from latentmotion import formats
from latentmotion.errors import DiskFullError, InputError, LatentMotionError
from latentmotion.motion import Motion
from latentmotion.viewer.page import payload


def encoded(motions: Sequence[Motion], form: str) -> tuple[bytes, str]:
    """Returns motions as bytes, and the format that these have.

    Args:
        motions: At least one.
        form: A format; where it holds a single take, several motions become a zip archive.

    Raises:
        LatentMotionError: The format needs what is not installed.
    """
    if form == "raw":
        return b"".join(motion.joints.astype("<f4").tobytes() for motion in motions), form
    if form == "viewer":
        return json.dumps(payload(motions), separators=(",", ":")).encode(), form
    if form == "json":
        entries = [
            {
                "prompt": motion.caption,
                "seconds": motion.seconds,
                "fps": motion.fps,
                "skeleton": motion.skeleton.name,
                "joints": motion.skeleton.names,
                "parents": motion.skeleton.parents,
                "positions": np.round(motion.joints.astype(float), 5).tolist(),
                "metadata": dict(motion.metadata),
            }
            for motion in motions
        ]
        plain = entries[0] if len(entries) == 1 else {"motions": entries}
        return json.dumps(plain, separators=(",", ":")).encode(), form
    if form == "glb":  # what services write most: files of their own take a tenth of its time
        from latentmotion.formats.gltf import make_document

        name = Path("motion.glb")
        formats.check_text(motions, name)
        return make_document(motions).encoded(name), form
    with tempfile.TemporaryDirectory() as folder:
        try:
            files = formats.save(Path(folder) / f"motion.{form}", motions)
        except DiskFullError:
            raise
        except LatentMotionError as error:
            raise InputError(str(error).replace(f"{folder}/", "")) from error
        return packed(files, form)


def packed(files: Sequence[Path], form: str) -> tuple[bytes, str]:
    """Returns a file's content, or several as a zip archive, and its format."""
    if len(files) == 1:
        return files[0].read_bytes(), form
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_STORED) as archive:
        for file in files:
            archive.write(file, file.name)
    return content.getvalue(), "zip"
