"""The run-time type checker of the tests; an int is welcome where a float is, as in Python."""

from collections.abc import Callable
from typing import Any

from beartype import BeartypeConf, beartype

_typed = beartype(conf=BeartypeConf(is_pep484_tower=True))


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Returns a function with checks; one inside of another, which each call makes anew, as is."""
    return function if "<locals>" in function.__qualname__ else _typed(function)
