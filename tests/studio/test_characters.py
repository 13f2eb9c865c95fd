"""Characters: their bones are found or guessed, corrected, and motions are put on them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latentmotion import Motion, formats
from tests.service.conftest import Called
from tests.studio.conftest import kept
from tests.support.simple_motions import figure

URL = "/studio/v1/characters"
WALK = Motion(figure(1.0, speed=1.0), caption="a person walks")
TOLD = {"id", "name", "bones", "mapping", "guessed", "missing", "problem", "deleted"}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A character with a mesh, one of bones alone, and one whose names say nothing."""
    folder = tmp_path_factory.mktemp("characters")
    WALK.save(folder / "hero.glb")
    WALK.save(folder / "hero.bvh")
    text = (folder / "hero.bvh").read_text()
    names = {name: f"n{i}" for i, name in enumerate(re.findall(r"(?:ROOT|JOINT) (\S+)", text))}
    for name, other in names.items():
        text = re.sub(rf"(ROOT|JOINT) {name}$", rf"\1 {other}", text, flags=re.MULTILINE)
    found = {name: (folder / name).read_bytes() for name in ("hero.glb", "hero.bvh")}
    return {**found, "hero.vrm": found["hero.glb"], "odd.bvh": text.encode()}


def added(studio: Called, files: dict[str, bytes], name: str) -> dict[str, Any]:
    answer = studio.wait(studio.client.post(f"{URL}?name={name}", content=files[name]))
    assert answer.status_code == 200, answer.text
    assert answer.json().keys() == TOLD
    return answer.json()


@pytest.mark.parametrize("name", ["hero.glb", "hero.vrm", "hero.bvh"])
def test_a_take_is_put_on_a_character(
    studio: Called, files: dict[str, bytes], tmp_path: Path, name: str
) -> None:
    character = added(studio, files, name)
    assert (character["guessed"], character["missing"], character["problem"]) == ([], [], None)
    assert character["mapping"]["left_wrist"] == "left_wrist"
    take = kept(studio.library, WALK).id
    answer = studio.get(f"/studio/v1/takes/{take}/on/{character['id']}.glb")
    assert answer.headers["content-type"] == "model/gltf-binary"
    path = tmp_path / "on.glb"
    path.write_bytes(answer.content)
    found = formats.load(path)[-1]
    np.testing.assert_allclose(found.joints[:, 0], WALK.joints[:, 0], atol=0.1)


def test_names_that_say_nothing_are_guessed_and_can_be_corrected(
    studio: Called, files: dict[str, bytes]
) -> None:
    character = added(studio, files, "odd.bvh")
    assert {"left_hip", "right_wrist"} <= set(character["guessed"])
    url = f"{URL}/{character['id']}"
    some = {"left_hip": character["mapping"]["left_hip"], "left_knee": None}
    corrected = studio.send("PATCH", url, {"mapping": some}).json()
    assert "left_knee" in corrected["missing"]
    take = kept(studio.library, WALK).id
    path = f"/studio/v1/takes/{take}/file?format=bvh&character={character['id']}"
    answer = studio.get(path)
    assert (answer.status_code, "left_knee" in answer.json()["detail"]) == (422, True)
    corrected = studio.send("PATCH", url, {"mapping": character["mapping"]}).json()
    assert (corrected["missing"], corrected["guessed"]) == ([], [])
    assert studio.get(path).text.startswith("HIERARCHY\nROOT n0")


@pytest.mark.parametrize(
    ("mapping", "told"),
    [
        ({"left_hip": "nobody"}, "'nobody'"),
        ({"tail": "left_hip"}, "map has 'tail'"),
        ({"left_hip": 3}, "string"),
    ],
)
def test_wrong_corrections_are_refused(
    studio: Called, files: dict[str, bytes], mapping: dict[str, Any], told: str
) -> None:
    character = added(studio, files, "hero.bvh")
    url = f"{URL}/{character['id']}"
    answer = studio.send("PATCH", url, {"mapping": mapping})
    assert answer.status_code == 422
    assert told in answer.json()["detail"]
    assert studio.get(url).json() == character


@pytest.mark.parametrize(
    ("name", "body", "told"),
    [
        ("hero.fbx", b"x", "expected .glb, .vrm, .bvh"),
        ("hero.glb", b"", "the body is empty"),
        ("hero.glb", b"glTF" + bytes(100), "character.glb"),
        ("hero.vrm", b"{}", "'hero.vrm' is no binary glTF"),
        ("hero.bvh", b"HIERARCHY\nROOT a\n", "character.bvh"),
        ("..%2F..%2Fhero.glb", b"x", "without folders"),
    ],
)
def test_files_that_are_no_characters_are_refused(
    studio: Called, name: str, body: bytes, told: str
) -> None:
    folder = studio.library.folder / "characters"
    before = set(folder.iterdir())
    answer = studio.wait(studio.client.post(f"{URL}?name={name}", content=body))
    assert answer.status_code == 422
    assert told in answer.json()["detail"]
    assert "/tmp" not in answer.text
    assert set(folder.iterdir()) == before


def test_a_deleted_character_can_be_restored(studio: Called, files: dict[str, bytes]) -> None:
    name = added(studio, files, "hero.bvh")["id"]
    studio.send("DELETE", f"{URL}/{name}")
    assert name not in {one["id"] for one in studio.get(URL).json()["characters"]}
    assert name in {one["id"] for one in studio.get(f"{URL}?deleted=true").json()["characters"]}
    studio.post(f"{URL}/{name}/restore")
    assert name in {one["id"] for one in studio.get(URL).json()["characters"]}
