"""A library that someone broke: what is damaged is shown as that, and stops nothing else."""

from __future__ import annotations

import sqlite3
import stat
from pathlib import Path
from typing import Any

import pytest

from latentmotion.motion import Motion
from latentmotion.studio.library import Library
from tests.service.conftest import Called
from tests.studio.conftest import kept
from tests.support.walker import walker

TAKES = "/studio/v1/takes"
DAMAGE: dict[str, Any] = {
    **{"edits": "{", "tags": "x", "recipe": "[1]", "goals": "[3]", "motion": "../x", "frames": "x"},
    **{"fps": 0.0, "made": b"\xff", "title": b"\xff"},
}


def motion() -> Motion:
    return Motion(walker(20).joints().astype("f4"), caption="a person walks")


@pytest.mark.parametrize("column", DAMAGE)
def test_a_damaged_take_is_shown_and_stops_nothing(studio: Called, column: str) -> None:
    library: Library = studio.library
    whole, bad = kept(library, motion()), kept(library, motion())
    with library._written() as database:
        database.execute(f"UPDATE takes SET {column} = ? WHERE id = ?", (DAMAGE[column], bad.id))
    answer = studio.get(TAKES)
    assert answer.status_code == 200, answer.text
    takes = {take["id"]: take for take in answer.json()["takes"]}
    assert (takes[whole.id]["damaged"], takes[bad.id]["damaged"]) == (False, True)
    assert takes[bad.id]["title"].startswith("damaged: its row")
    assert studio.get(f"{TAKES}?tag=one").status_code == 200
    for path in ("", "/motion?format=glb", "/file?format=glb", "/again"):
        for method in ("GET", "POST"):
            assert studio.send(method, f"{TAKES}/{bad.id}{path}").status_code < 500
    with library._written() as database:
        database.execute("DELETE FROM takes WHERE id = ?", (bad.id,))


@pytest.mark.parametrize("bones", ["{", "[]", '{"mapping": 3}', '{"problem": null}'])
def test_a_damaged_character_says_what_is_wrong(library: Library, bones: str) -> None:
    with library._written() as database:
        row = "0" * 26, "Ann", "glb", bones, 0
        database.execute("INSERT INTO characters VALUES (?, ?, ?, ?, ?)", row)
    (character,) = library.characters()
    assert "cannot be read" in character.about()["problem"]


@pytest.mark.parametrize(
    ("code", "status"),
    [(sqlite3.SQLITE_BUSY, 503), (sqlite3.SQLITE_FULL, 507), (sqlite3.SQLITE_CORRUPT, 503)],
)
def test_errors_of_the_database_are_told(
    studio: Called, code: int, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any, **__: Any) -> Any:
        error = sqlite3.OperationalError("the database says so")
        error.sqlite_errorcode = code
        raise error

    monkeypatch.setattr(studio.library, "takes", fails)
    answer = studio.get(TAKES)
    assert answer.status_code == status
    assert "retry-after" in answer.headers
    assert answer.json()["detail"]


def test_nobody_else_reads_the_library(library: Library) -> None:
    def mode(path: Path) -> int:
        return stat.S_IMODE(path.stat().st_mode)

    assert mode(library.folder) == 0o700
    assert mode(library.folder / "library.sqlite3") == 0o600
