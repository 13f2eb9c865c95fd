"""Projects: one JSON file each, and no name leads out of their folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.service.conftest import Called

URL = "/studio/v1/projects"
PROJECT: dict[str, Any] = {
    "format": 1,
    "takes": ["01M83KC31REF7RP72GNKH69SHQ"],
    "timeline": [{"prompt": "a person walks", "seconds": 3.0}],
    "goals": [{"joint": "right_wrist", "at": 1.0, "to": [None, 1.4, None]}],
    "settings": {"camera": [1, 2, 3], "Größe": "ß"},
}


@pytest.mark.parametrize("name", ["a", "My film 1", "Übung_2", "x" * 80])
def test_a_project_comes_back_as_it_was(studio: Called, name: str) -> None:
    assert studio.send("PUT", f"{URL}/{name}", PROJECT).status_code == 200
    found = studio.get(f"{URL}/{name}").json()
    goals = [kept | PROJECT["goals"][0] for kept in found["goals"]]  # with what is left out
    assert found == found | PROJECT | {"name": name, "goals": goals} and len(goals) == 1
    file: Path = studio.library.folder / "projects" / f"{name}.json"
    assert json.loads(file.read_text(encoding="utf-8")) == found
    assert name in [one["name"] for one in studio.get(URL).json()["projects"]]
    assert studio.send("DELETE", f"{URL}/{name}").json() == {"removed": found}
    assert not file.exists()
    assert studio.get(f"{URL}/{name}").status_code == 404


@pytest.mark.parametrize(
    "name", ["..%2Fx", "%2e%2e", ".x", "a.b", "a%00", " x", "x%0A", "x" * 81, "-", "a%5Cb", "C%3A"]
)
def test_names_that_are_no_files_here_are_refused(studio: Called, name: str) -> None:
    folder: Path = studio.library.folder
    before = sorted(folder.rglob("*"))
    assert studio.send("PUT", f"{URL}/{name}", PROJECT).status_code in (404, 405, 422)
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    "changes", [{"format": 2}, {"takes": ["x"]}, {"goals": [{}]}, {"timeline": 3}, {"more": 1}]
)
def test_a_project_of_another_form_is_refused(studio: Called, changes: dict[str, Any]) -> None:
    assert studio.send("PUT", f"{URL}/other", PROJECT | changes).status_code == 422
    assert studio.get(f"{URL}/other").status_code == 404


def test_a_file_that_someone_broke_is_told(studio: Called) -> None:
    folder: Path = studio.library.folder / "projects"
    for text, told in (("{", "broken.json"), ('{"format": 7}', "of format 7, expected 1")):
        (folder / "broken.json").write_text(text)
        answer = studio.get(f"{URL}/broken")
        assert answer.status_code == 422
        assert told in answer.json()["detail"]
    (folder / "broken.json").unlink()


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("con", {}),
        ("LPT1", {}),
        ("half", {"settings": {"a": "\ud800"}}),
        ("deep", {"settings": {"a": json.loads("[" * 500 + "]" * 500)}}),
        ("number", {"settings": {"a": float("nan")}}),
    ],
)
def test_what_no_file_can_hold_is_refused(
    studio: Called, name: str, changes: dict[str, Any]
) -> None:
    content = json.dumps(PROJECT | changes)
    headers = {"Content-Type": "application/json"}
    answer = studio.wait(studio.client.put(f"{URL}/{name}", content=content, headers=headers))
    assert answer.status_code in (400, 422), answer.text
    assert studio.get(f"{URL}/{name}").status_code == 404


def test_names_of_many_bytes_and_of_other_case(studio: Called) -> None:
    assert studio.send("PUT", f"{URL}/{'漢' * 80}", PROJECT).status_code == 200
    assert studio.send("PUT", f"{URL}/Straße", PROJECT).status_code == 200
    for name in ("STRASSE", "straße"):
        answer = studio.send("PUT", f"{URL}/{name}", PROJECT)
        assert answer.status_code == 422
        assert "'Straße' are one file on macOS and Windows" in answer.json()["detail"]
    assert studio.send("PUT", f"{URL}/Straße", PROJECT).status_code == 200
