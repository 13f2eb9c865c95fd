"""Configurations come back as they went out, and nothing misspelled passes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest

from latentmotion.errors import InputError
from latentmotion.storage.configuration import from_json, read_json, to_json, write_json


@dataclass(frozen=True)
class Circle:
    radius: float = 1.0


@dataclass(frozen=True)
class Square:
    side: float = 1.0


@dataclass(frozen=True)
class Drawing:
    shape: Circle | Square
    layers: int = 3
    color: Literal["red", "blue"] = "red"
    points: tuple[float, ...] = ()
    note: str | None = None
    flag: bool = False
    extra: dict[str, float] = field(default_factory=dict)


def test_round_trip_through_a_file(tmp_path: Path) -> None:
    drawing = Drawing(Square(2.0), points=(1.0, 2.5), note="x", flag=True, extra={"a": 1.0})
    write_json(tmp_path / "drawing.json", drawing)
    assert read_json(Drawing, tmp_path / "drawing.json") == drawing


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"layer": 3}, "unknown key 'layer'; did you mean 'layers'"),
        ({"layers": "three"}, "layers: expected int, found 'three'"),
        ({"layers": True}, "layers: expected int"),
        ({"color": "green"}, "expected one of red, blue"),
        ({"points": 3}, "points: expected a list"),
        ({"shape": {"kind": "Circle", "radios": 2}}, "shape: unknown key 'radios'"),
        ({"shape": {"kind": "Star"}}, "kind to be one of Circle, Square"),
        ({"note": 3}, "note: expected str"),
    ],
)
def test_errors_name_the_key(change: dict, message: str) -> None:
    data = {**to_json(Drawing(Circle())), **change}
    with pytest.raises(InputError, match=message):
        from_json(Drawing, data)


def test_missing_key() -> None:
    with pytest.raises(InputError, match="missing key 'shape'"):
        from_json(Drawing, {"layers": 3})


def test_file_that_is_not_json(tmp_path: Path) -> None:
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(InputError, match="not JSON"):
        read_json(Drawing, tmp_path / "broken.json")
    with pytest.raises(InputError, match=r"cannot be read: No such file.*check its path"):
        read_json(Drawing, tmp_path / "absent.json")
