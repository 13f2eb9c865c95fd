"""Picture strips of samples along the way; left out where Pillow is not installed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from latentmotion.errors import MissingExtraError
from latentmotion.motion import Motion


def write_strip(path: Path, motions: Sequence[Motion]) -> None:
    """Writes `motions` as a picture, a row each; does nothing without Pillow or motions."""
    try:
        from latentmotion.render.strip import write
    except MissingExtraError:
        return
    if motions:
        write(path, motions)
