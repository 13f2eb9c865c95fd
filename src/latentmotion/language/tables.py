"""The tables of this room, read once."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def data(name: str) -> dict[str, Any]:
    """Returns a table, by the name of its file."""
    return tomllib.loads(files("latentmotion.language").joinpath(name).read_text(encoding="utf-8"))
