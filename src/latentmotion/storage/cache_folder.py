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
    try:
        return _usual() / "latentmotion"
    except RuntimeError:  # a user without a home
        return None


def _usual() -> Path:
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    variable = "LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME"
    named = os.environ.get(variable)
    return Path(named) if named else Path.home() / ".cache"
