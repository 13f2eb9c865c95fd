"""Kinds of acts and what is known of each: the table that measuring, language and captions share.

It is data (`acts.toml`, `[kinds]`), so that whether a jump can be counted is said in one place. No
sentence is read here.

The tables of this room, read once.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any


@cache
def kinds(trait: str) -> tuple[str, ...]:
    """Returns the kinds with a trait."""
    return tuple(
        kind for kind, row in data("acts.toml")["kinds"].items() if trait in row["traits"].split()
    )


@cache
def related(relation: str) -> Mapping[str, tuple[str, ...]]:
    """Returns the kinds that kinds are related to: `similar`, `shown_by` or `looks_like`."""
    table = {
        kind: row[relation] for kind, row in data("acts.toml")["kinds"].items() if relation in row
    }
    return MappingProxyType({kind: tuple(others.split()) for kind, others in table.items()})


@cache
def limits(name: str) -> Mapping[str, float]:
    """Returns a limit of kinds: `rise` or `plain`."""
    return MappingProxyType(
        {kind: row[name] for kind, row in data("acts.toml")["kinds"].items() if name in row}
    )


@cache
def data(name: str) -> dict[str, Any]:
    """Returns a table, by the name of its file."""
    return tomllib.loads(files("latentmotion.language").joinpath(name).read_text(encoding="utf-8"))
