"""Parts of models that other installed packages add, by the names in their entry points."""

from __future__ import annotations

from typing import Any

from latentmotion.errors import InputError, hint
from latentmotion.plugins import Group, plugin, plugin_names


def part_named(group: Group, name: str) -> Any:
    """Returns what an entry point names: a class or function.

    Only installed packages are asked, so a card or an experiment of others can name no code.

    Raises:
        InputError: There is none of this name, with the nearest; or it cannot be loaded.
    """
    names = plugin_names(group)
    if name not in names:
        advice = hint(name, names) if names else "no installed package adds one"
        raise InputError(f"{group}: nothing is called {name!r}; {advice}")
    part = plugin(group, name)
    if part is None:
        raise InputError(f"{group}: {name!r} cannot be loaded; see the warning above")
    return part
