"""Plugins: objects that other installed packages add by entry points.

    [project.entry-points."latentmotion.formats"]
    trc = "my_package.trc"

Nothing is looked up before a name is needed that this package does not have.
"""

from __future__ import annotations

import warnings
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint, EntryPoints

Group = Literal[
    "latentmotion.data_sources",
    "latentmotion.formats",
    "latentmotion.loggers",
    "latentmotion.skeletons",
]
"""Kinds of plugins."""


def plugin_names(group: Group) -> tuple[str, ...]:
    """Returns the names of the installed plugins of a group, none of which is loaded."""
    return tuple(sorted(_entry_points(group).names))


def plugin(group: Group, name: str) -> Any | None:
    """Returns a plugin; None if there is none of that name, or it is broken, which is warned of."""
    entries = _entry_points(group)
    return _loaded(entries[name]) if name in entries.names else None


def plugins(group: Group) -> dict[str, Any]:
    """Returns all plugins of a group by name, but for broken ones, which are warned of."""
    loaded = {name: plugin(group, name) for name in plugin_names(group)}
    return {name: each for name, each in loaded.items() if each is not None}


def warn_of(group: Group, name: str, error: Exception) -> None:
    """Warns that a plugin fails and is left out."""
    reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    warnings.warn(
        f"the plugin {name!r} of {group} is left out: {reason}", RuntimeWarning, stacklevel=3
    )


def _entry_points(group: Group) -> EntryPoints:
    from importlib.metadata import entry_points  # which takes 20 ms to import

    return entry_points(group=group)


@cache
def _loaded(entry: EntryPoint) -> Any | None:
    try:
        return entry.load()
    except Exception as error:  # of a package that is not ours
        warn_of(entry.group, entry.name, error)  # type: ignore[arg-type]
        return None
