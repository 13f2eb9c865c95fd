"""The run-time checks of the tests: shapes of arrays, and the types beside them.

A function that names no shape is left as it is: its types are pyright's to check, and to bind its
arguments to a signature once more would take a third of the time of all tests.
"""

from __future__ import annotations

import re
import typing
from collections.abc import Callable
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray, AbstractDtype

# An int is welcome where a float is, as in Python.
checked = beartype(conf=BeartypeConf(is_pep484_tower=True))

_jaxtyped = jaxtyping.jaxtyped

_NAME = re.compile(r"[A-Za-z_]\w*(?:\.\w+)*")


def jaxtyped(*, typechecker: Any) -> Callable[[Any], Any]:
    """Returns jaxtyping's decorator for what names shapes, which its import hook puts on all."""

    def decorate(item: Any) -> Any:
        function = vars(item).get("__init__") if isinstance(item, type) else item
        return _jaxtyped(item, typechecker=typechecker) if _names_shapes(function) else item

    return decorate


def _names_shapes(function: Any) -> bool:
    """Says whether annotations of a function name a shape; of one inside of another it is no."""
    if function is None or "<locals>" in function.__qualname__:
        return False
    words = " ".join(map(str, function.__annotations__.values()))
    return any(_shaped(_resolved(name, function.__globals__)) for name in _NAME.findall(words))


def _resolved(name: str, names: dict[str, Any]) -> Any:
    first, *rest = name.split(".")
    value = names.get(first)
    for attribute in rest:
        value = getattr(value, attribute, None)
    return value


def _shaped(hint: Any) -> bool:
    if isinstance(hint, type) and issubclass(hint, (AbstractArray, AbstractDtype)):
        return True
    return any(map(_shaped, hint if isinstance(hint, list) else typing.get_args(hint)))
