"""Finding the files of a data set wherever in a folder they lie."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path


def files_below(folder: Path, endings: Collection[str]) -> list[Path]:
    """Returns the files below a folder by their endings, sorted; links to folders are followed.

    Args:
        folder: Where to look, at any depth.
        endings: Endings in lower case, as `.bvh`; those of files may be in either.
    """
    found, seen = [], set()
    for place, folders, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(place)
        if real in seen:  # A link that leads back.
            folders.clear()
            continue
        seen.add(real)
        found += [Path(place, name) for name in names if Path(name).suffix.lower() in endings]
    return sorted(found)
