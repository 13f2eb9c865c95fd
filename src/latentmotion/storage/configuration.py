"""Frozen dataclasses to JSON and strictly back: a misspelled key is an error, never ignored."""

from __future__ import annotations

import dataclasses
import functools
import json
import reprlib
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from latentmotion.errors import FileFormatError, InputError, hint
from latentmotion.plugins import Group, plugin, plugin_names
from latentmotion.storage import files, reading

T = TypeVar("T")


def kind_of(cls: type) -> str:
    """Returns the name of a dataclass in files: its `KIND`, or else the name of the class."""
    return vars(cls).get("KIND", cls.__name__)


def to_json(value: Any) -> Any:
    """Turns (nested) dataclasses into plain JSON values, each with its kind."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: to_json(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"kind": kind_of(type(value)), **fields}
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(item) for item in value]
    return value


def from_json(cls: type[T], data: Any, where: str = "") -> T:
    """Builds the dataclass `cls` from what `to_json` made.

    Raises:
        InputError: A key is unknown, missing or of the wrong type; the message names the nearest.
    """
    if not isinstance(data, Mapping):
        raise InputError(f"{where or cls.__name__}: expected an object, found {reprlib.repr(data)}")
    entries = {key: value for key, value in data.items() if key != "kind"}
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    for key in entries:
        if key not in fields:
            raise InputError(
                f"{where or cls.__name__}: unknown key {key[:80]!r}; {hint(key, fields)}"
            )
    absent = dataclasses.MISSING
    needed = [n for n, f in fields.items() if f.default is absent and f.default_factory is absent]
    missing = ", ".join(repr(name) for name in needed if name not in entries)
    if missing:
        raise InputError(f"{where or cls.__name__}: missing key {missing}")
    hints = _type_hints(cls)
    prefix = f"{where}." if where else ""
    values = {key: _convert(hints[key], value, prefix + key) for key, value in entries.items()}
    return cls(**values)


def write_json(path: str | Path, value: Any) -> None:
    """Writes a dataclass as indented JSON."""
    files.write_file(path, json.dumps(to_json(value), indent=1) + "\n")


def read_json(cls: type[T], path: str | Path) -> T:
    """Reads a dataclass that `write_json` wrote.

    Raises:
        InputError: The file is missing, is not JSON or does not fit the dataclass.
    """
    data = read_plain(path)
    try:
        return from_json(cls, data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_plain(path: str | Path) -> Any:
    """Reads a JSON file as plain values.

    Raises:
        InputError: The file is missing or is not JSON.
    """
    try:
        return reading.read_json_file(path)
    except FileFormatError as error:
        raise InputError(str(error)) from error


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


# Evaluated once for each class, since requests of the service are read so, too.
_type_hints = functools.cache(typing.get_type_hints)


def _convert(hint: Any, value: Any, where: str) -> Any:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if value is None and type(None) in arguments:
            return None
        classes = {
            kind_of(m): m for m in arguments if isinstance(m, type) and dataclasses.is_dataclass(m)
        }
        if classes and isinstance(value, Mapping):
            kind = value.get("kind", next(iter(classes)) if len(classes) == 1 else None)
            is_kind = isinstance(kind, str) and kind in classes
            _check(is_kind, kind, f"kind to be one of {', '.join(classes)}", where)
            return from_json(typing.cast(type, classes[typing.cast(str, kind)]), value, where)
        plain = [m for m in arguments if m is not type(None) and not dataclasses.is_dataclass(m)]
        _check(bool(plain), value, " or ".join(classes) or "null", where)
        return _convert(plain[0], value, where)
    if dataclasses.is_dataclass(hint):
        return from_json(typing.cast(type, hint), value, where)
    if origin is tuple:
        items = _check(isinstance(value, (list, tuple)), value, "a list", where)
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return tuple(_convert(arguments[0], item, where) for item in items)
        _check(len(items) == len(arguments), value, f"{len(arguments)} values", where)
        pairs = zip(arguments, items, strict=True)
        return tuple(_convert(member, item, where) for member, item in pairs)
    if origin is typing.Literal:
        return _check(value in arguments, value, f"one of {', '.join(map(str, arguments))}", where)
    if hint is float:
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return float(_check(number, value, "a number", where))
    cls = origin or hint
    if isinstance(cls, type) and cls is not object:
        fits = isinstance(value, cls) and (cls is bool or not isinstance(value, bool))
        return _check(fits, value, cls.__name__, where)
    return value


def _check(fits: bool, value: Any, expected: str, where: str) -> Any:
    if not fits:
        raise InputError(f"{where}: expected {expected}, found {reprlib.repr(value)}")
    return value
