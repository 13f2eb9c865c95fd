"""Takes over HTTP: what is shown is what is written; lists, edits, import and archives."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from latentmotion import Motion, formats
from latentmotion.kinematics.skeleton import HUMANML3D
from tests.service.conftest import Called
from tests.studio.conftest import kept
from tests.support.simple_motions import figure

URL = "/studio/v1/takes"
WALK = Motion(figure(1.5, speed=1.0), caption="a person walks to the left")


@pytest.fixture
def take(studio: Called) -> Iterator[str]:
    """A take with all edits."""
    name = kept(studio.library, WALK).id
    edits = {"trim": [0.2, 1.2], "speed": 1.5, "in_place": True, "mirrored": True}
    answer = studio.send("PATCH", f"{URL}/{name}", edits)
    assert answer.json()["edits"] == edits
    yield name
    studio.send("DELETE", f"{URL}/{name}")


def content(studio: Called, path: str) -> bytes:
    answer = studio.get(path)
    assert answer.status_code == 200, answer.text
    return answer.content


def loaded(tmp_path: Path, data: bytes, ending: str) -> Motion:
    path = tmp_path / f"take.{ending}"
    path.write_bytes(data)
    return formats.load(path)[0]


def test_joints_of_several_takes_come_at_once(studio: Called, take: str) -> None:
    other = kept(studio.library, WALK).id
    one, two, both = (
        studio.get(f"/studio/v1/{path}")
        for path in (
            f"takes/{take}/joints",
            f"takes/{other}/joints",
            f"joints?take={take}&take={other}",
        )
    )
    assert both.content == one.content + two.content != two.content
    for header in ("x-frames", "x-fps"):
        assert both.headers[header] == f"{one.headers[header]},{two.headers[header]}"
    assert studio.get("/studio/v1/joints").status_code == 422


def test_what_the_screen_shows_is_what_is_written(
    studio: Called, take: str, tmp_path: Path
) -> None:
    answer = studio.get(f"{URL}/{take}/joints")
    frames, fps = int(answer.headers["x-frames"]), float(answer.headers["x-fps"])
    shown = np.frombuffer(answer.content, "<f4").reshape(frames, 22, 3)
    assert (frames, fps) == (20, 30.0)
    written = loaded(tmp_path, content(studio, f"{URL}/{take}/file?format=npz"), "npz")
    np.testing.assert_array_equal(written.joints, shown)
    assert (written.fps, written.caption) == (30.0, "a person walks to the right")
    for ending in ("glb", "bvh"):
        data = content(studio, f"{URL}/{take}/file?format={ending}")
        found = loaded(tmp_path, data, ending)
        np.testing.assert_allclose(found.joints, shown, atol=2e-3)
    resampled = content(studio, f"{URL}/{take}/file?format=npz&fps=60")
    assert loaded(tmp_path, resampled, "npz").fps == 60


def test_a_file_is_named_by_the_title_in_plain_letters(studio: Called, take: str) -> None:
    studio.send("PATCH", f"{URL}/{take}", {"title": 'Grüße "a"; ../../x'})
    answer = studio.get(f"{URL}/{take}/file?format=csv")
    expected = f'attachment; filename="gr-e-a-x-{take[-6:].lower()}.csv"'
    assert answer.headers["content-disposition"] == expected


def test_the_viewer_reads_a_take(studio: Called, take: str) -> None:
    answer = studio.get(f"{URL}/{take}/viewer")
    assert answer.headers["content-type"] == "application/json"
    assert answer.json()


def test_the_list_finds_pages_and_counts(studio: Called, take: str) -> None:
    studio.send("PATCH", f"{URL}/{take}", {"title": "zebra", "tags": ["b", "a", "b"], "star": True})
    found = studio.get(f"{URL}?query=ZEB&tag=b&star=true").json()
    assert (found["total"], found["takes"][0]["id"]) == (1, take)
    assert found["takes"][0]["tags"] == ["b", "a"]
    assert {"a", "b"} <= set(found["tags"])
    assert studio.get(f"{URL}?query=zebra&offset=1").json()["takes"] == []


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"trim": [1, 0.5]}, "times in order"),
        ({"trim": [0, 60]}, "from 0 to 1.5 s"),
        ({"speed": 100}, "0.1 to 10"),
        ({"title": ""}, "1 to 200 letters"),
        ({"title": "a\u0000b"}, "1 to 200 letters"),
        ({"tags": [" "]}, "1 to 50 letters"),
        ({"motion": "0" * 64}, "motion"),
    ],
)
def test_changes_that_cannot_be_made_are_refused(
    studio: Called, take: str, changes: dict[str, Any], told: str
) -> None:
    before = studio.get(f"{URL}/{take}").json()
    answer = studio.send("PATCH", f"{URL}/{take}", changes)
    assert answer.status_code == 422
    assert told in answer.json()["detail"]
    assert studio.get(f"{URL}/{take}").json() == before


def test_a_motion_that_is_gone_is_told(studio: Called) -> None:
    library = studio.library
    take = kept(library, Motion(WALK.joints[:7]))
    (library.folder / "motions" / f"{take.motion}.npz").unlink()
    assert studio.get(f"{URL}/{take.id}").json()["missing"]
    for path in ("joints", "file?format=glb"):
        answer = studio.get(f"{URL}/{take.id}/{path}")
        assert answer.status_code == 410
        assert "is missing" in answer.json()["detail"]


@pytest.mark.parametrize("ending", ["npz", "bvh"])
def test_an_imported_motion_becomes_a_take(studio: Called, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"my walk.{ending}"
    WALK.save(path)
    url = f"/studio/v1/import?name={path.name}"
    answer = studio.wait(studio.client.post(url, content=path.read_bytes()))
    (take,) = answer.json()["takes"]
    assert take["recipe"] == {"imported": path.name}
    shown = np.frombuffer(content(studio, f"{URL}/{take['id']}/joints"), "<f4")
    np.testing.assert_allclose(shown.reshape(-1, 22, 3), WALK.joints, atol=2e-3)
    again = studio.post(f"{URL}/{take['id']}/again")
    assert (again.status_code, "was imported" in again.text) == (422, True)


@pytest.mark.parametrize(
    ("name", "body", "told"),
    [
        ("x.exe", b"x", "no motion that can be read"),
        ("x.bvh", b"", "the body is empty"),
        ("x.bvh", b"\0" * 100, "binary"),
        ("x.glb", b"glTF", "motion.glb"),
        ("x.npz", b"PK", "motion.npz"),
        ("a%2Fx.bvh", b"x", "without folders"),
    ],
)
def test_files_that_are_no_motions_are_refused(
    studio: Called, name: str, body: bytes, told: str
) -> None:
    before = studio.get(URL).json()["total"]
    answer = studio.wait(studio.client.post(f"/studio/v1/import?name={name}", content=body))
    assert answer.status_code == 422
    assert told in answer.json()["detail"]
    assert studio.get(URL).json()["total"] == before


def test_notes_of_foreign_files_are_not_believed(studio: Called, tmp_path: Path) -> None:
    foreign = Motion(WALK.joints, metadata={"goals": ["x"], "spans": 3})
    foreign.save(tmp_path / "foreign.npz")
    data = (tmp_path / "foreign.npz").read_bytes()
    answer = studio.wait(studio.client.post("/studio/v1/import?name=foreign.npz", content=data))
    (take,) = answer.json()["takes"]
    assert take["goals"] is None
    assert studio.get(f"{URL}/{take['id']}/viewer").status_code == 200


def test_other_skeletons_are_refused(studio: Called, tmp_path: Path) -> None:
    from latentmotion.kinematics.skeleton import KIT

    path = tmp_path / "kit.npz"
    Motion(np.zeros((4, len(KIT), 3)) + KIT.rest_joints(), skeleton=KIT).save(path)
    url = "/studio/v1/import?name=kit.npz"
    answer = studio.wait(studio.client.post(url, content=path.read_bytes()))
    assert answer.status_code == 422
    assert f"expected the {len(HUMANML3D)}" in answer.json()["detail"]


def test_an_archive_holds_a_file_for_each_take(studio: Called, take: str) -> None:
    other = kept(studio.library, WALK).id
    answer = studio.post("/studio/v1/export", {"ids": [take, other], "format": "csv"})
    with zipfile.ZipFile(io.BytesIO(answer.content)) as archive:
        assert len(archive.namelist()) == 2
        first = archive.read(archive.namelist()[0])
    assert first == content(studio, f"{URL}/{take}/file?format=csv")


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ({"ids": []}, 422),
        ({"ids": ["01M83KC31REF7RP72GNKH69SHQ"]}, 404),
        ({"ids": ["../x"]}, 422),
        ({"ids": ["01M83KC31REF7RP72GNKH69SHQ"] * 501}, 422),
    ],
)
def test_archives_of_nothing_are_refused(studio: Called, body: dict[str, Any], status: int) -> None:
    assert studio.post("/studio/v1/export", body).status_code == status
