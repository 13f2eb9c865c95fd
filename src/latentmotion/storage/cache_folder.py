"""The folder of this user's caches: the platform's, or that in LATENTMOTION_CACHE."""

from __future__ import annotations

import os
import sys
from pathlib import Path

VARIABLE = "LATENTMOTION_CACHE"
"""Environment variable with a folder, or `off`."""


def cache_folder() -> Path | None:
    """Returns the folder, which need not exist; None if caching is off."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        return None if chosen == "off" else Path(chosen)
    variable = "LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME"
    named = os.environ.get(variable) if sys.platform != "darwin" else None
    if named:
        return Path(named) / "latentmotion"
    try:
        caches = "Library/Caches" if sys.platform == "darwin" else ".cache"
        return Path.home() / caches / "latentmotion"
    except RuntimeError:  # a user without a home
        return None
