"""Where this user's caches are: as the platform has it, or as LATENTMOTION_CACHE says."""

from __future__ import annotations

import os
import sys
from pathlib import Path

VARIABLE = "LATENTMOTION_CACHE"
"""Environment variable with a folder, or `off`."""


def cache_folder() -> Path | None:
    """Returns the folder, which need not exist; None where there shall be no cache."""
    said = os.environ.get(VARIABLE)
    if said:
        return None if said == "off" else Path(said)
    variable = "LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME"
    named = os.environ.get(variable) if sys.platform != "darwin" else None
    if named:
        return Path(named) / "latentmotion"
    try:
        caches = "Library/Caches" if sys.platform == "darwin" else ".cache"
        return Path.home() / caches / "latentmotion"
    except RuntimeError:  # a user without a home
        return None
