"""JSON Schema of what `from_json` reads, which the published schemas must equal."""

from __future__ import annotations

import dataclasses
import inspect
import types
import typing
from typing import Any

from latentmotion.storage.configuration import kind_of

_JSON_TYPES = {
    **{float: "number", int: "integer", str: "string", bool: "boolean", type(None): "null"},
}


def _schema_of(hint: Any) -> dict[str, Any]:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        kinds, options = typing.get_type_hints(hint), dataclasses.fields(hint)
        return {
            "type": "object",
            "description": inspect.cleandoc(hint.__doc__ or ""),
            "properties": {
                "kind": {"const": kind_of(typing.cast(type, hint))},
                **{option.name: _schema_of(kinds[option.name]) for option in options},
            },
            "required": [
                f.name for f in options if f.default is dataclasses.MISSING is f.default_factory
            ],
            "additionalProperties": False,
        }
    if origin in (typing.Union, types.UnionType):
        members = [_schema_of(member) for member in arguments]
        classes = [member for member in members if "kind" in member.get("properties", {})]
        if len(classes) > 1:
            for member in classes:
                member["required"] = ["kind", *member["required"]]
        return {"anyOf": members}
    if origin is tuple and arguments[-1] is Ellipsis:
        return {"type": "array", "items": _schema_of(arguments[0])}
    if origin is tuple:
        items = [_schema_of(member) for member in arguments]
        return {"type": "array", "prefixItems": items, "minItems": len(items), "items": False}
    if origin is typing.Literal:
        return {"enum": list(arguments)}
    if origin is dict:
        return {"type": "object", "additionalProperties": _schema_of(arguments[1])}
    return {} if hint is Any else {"type": _JSON_TYPES[hint]}


def json_schema(cls: type, title: str) -> dict[str, Any]:
    """Returns the JSON Schema of what `from_json` reads as a dataclass.

    It knows types and keys; ranges of numbers are checked by the dataclasses themselves.
    """
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": title}
    return {**head, **_schema_of(cls)}
