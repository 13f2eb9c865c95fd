"""Plugins and registered functions: what is looked up by name, so that a room need not be known.

    [project.entry-points."latentmotion.formats"]
    trc = "my_package.trc"

Other installed packages add plugins by entry points; none is looked up before a name is needed that
this package does not have. This package registers functions of its own rooms for those below them:
a motion saves itself, but does not import the formats.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, TypeVar

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint, EntryPoints

F = TypeVar("F", bound=Callable[..., Any])

# Kinds of plugins.
Group = Literal[
    "latentmotion.data_sources",
    "latentmotion.denoisers",
    "latentmotion.formats",
    "latentmotion.loggers",
    "latentmotion.metrics",
    "latentmotion.samplers",
    "latentmotion.schedules",
    "latentmotion.skeletons",
    "latentmotion.text_encoders",
    "latentmotion.vaes",
]


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


def register(name: str, function: str) -> None:
    """Registers a function of another room.

    Args:
        name: What it is looked up by, such as `motion.save`.
        function: `module:function`, which is imported when it is looked up.
    """
    _FUNCTIONS[name] = function


def registered(name: str) -> Callable[..., Any]:
    """Returns the function that was registered by a name."""
    module, _, function = _FUNCTIONS[name].partition(":")
    return getattr(import_module(module), function)


def entries(table: dict[str, F]) -> Callable[..., Callable[[F], F]]:
    """Returns a decorator, called with names, that enters a function of a module in its table."""

    def named(*names: str) -> Callable[[F], F]:
        def enter(function: F) -> F:
            table.update(dict.fromkeys(names, function))
            return function

        return enter

    return named


_FUNCTIONS: dict[str, str] = {}


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
