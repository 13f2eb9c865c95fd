"""The library: takes come back as they were kept, whatever happens to its files."""

from __future__ import annotations

import re
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from latentmotion import Motion
from latentmotion.errors import InputError
from latentmotion.studio.library import ID, Edits, Library, MissingMotionError, UnknownError
from tests.studio.conftest import kept
from tests.support.simple_motions import figure

WALK = Motion(figure(2.0, speed=1.0), caption="a person walks to the left")


def test_takes_are_listed_from_the_newest_on_whatever_their_names(library: Library) -> None:
    names = [kept(library, WALK).id for _ in range(20)]
    assert all(re.fullmatch(ID, name) for name in names) and len(set(names)) == 20
    ulid = "01M83KC31REF7RP72GNKH69SHQ"  # as libraries had them until November 2026
    with sqlite3.connect(library.folder / "library.sqlite3") as database:
        database.execute("UPDATE takes SET id = ? WHERE id = ?", (ulid, names[3]))
    expected = [*names[:3], ulid, *names[4:]][::-1]
    assert [take.id for take in library.takes()[1]] == expected
    assert library.take(ulid).title == WALK.caption and re.fullmatch(ID, ulid)


def test_a_motion_comes_back_to_the_bit(library: Library) -> None:
    take = library.take(kept(library, WALK).id)
    assert library.motion(take).joints.tobytes() == WALK.joints.tobytes()
    assert (take.about()["frames"], take.about()["seconds"]) == (40, 2.0)
    assert not take.missing


def test_equal_motions_share_a_file_and_takes_stay_two(library: Library) -> None:
    first, second = kept(library, WALK), kept(library, WALK)
    copy = library.duplicate(first.id)
    assert first.motion == second.motion == copy.motion
    assert len(list((library.folder / "motions").iterdir())) == 1
    assert library.takes()[0] == 3
    assert copy.title == "a person walks to the left (copy)"


@pytest.mark.parametrize(
    ("edits", "frames", "fps"),
    [
        (Edits(), 40, 20.0),
        (Edits(trim=(0.5, 1.5)), 20, 20.0),
        (Edits(speed=2.0), 40, 40.0),
        (Edits(trim=(0.5, 1.0), speed=0.5, in_place=True, mirrored=True), 10, 10.0),
    ],
)
def test_edits_are_applied_on_reading(
    library: Library, edits: Edits, frames: int, fps: float
) -> None:
    take = library.change(kept(library, WALK).id, edits=edits)
    motion = library.motion(library.take(take.id))
    assert (len(motion), motion.fps) == (frames, fps)
    assert (take.about()["frames"], take.about()["fps"]) == (frames, fps)
    assert library.stored(take.motion).joints.tobytes() == WALK.joints.tobytes()


def test_edits_do_what_they_say() -> None:
    still = Edits(in_place=True).applied(WALK)
    assert np.ptp(WALK.joints[:, 0, 2]) > 1.5 > 0.2 > np.ptp(still.joints[:, 0, 2])
    np.testing.assert_array_equal(still.joints[..., 1], WALK.joints[..., 1])
    other = Edits(mirrored=True).applied(WALK)
    np.testing.assert_array_equal(other.joints, WALK.mirrored().joints)
    assert other.caption == "a person walks to the right"
    assert Edits().applied(WALK) is WALK


@pytest.mark.parametrize("trim", [(1.0, 0.5), (0.0, 3.0), (1.0, 1.01)])
def test_a_trim_that_leaves_nothing_is_refused_and_nothing_changes(
    library: Library, trim: tuple[float, float]
) -> None:
    take = kept(library, WALK)
    with pytest.raises(InputError, match="from 0 to 2 s"):
        library.change(take.id, title="other", edits=Edits(trim=trim))
    assert library.take(take.id) == take


def test_search_looks_at_titles_prompts_and_tags(library: Library) -> None:
    walk = kept(library, WALK)
    jump = kept(library, Motion(WALK.joints, caption="Überschlag"), timeline=[{"prompt": "a JUMP"}])
    library.change(walk.id, tags=("hero", "50%"), star=True)
    library.change(jump.id, title="fall")
    kinds = {
        "left WALKS": [walk],
        "überschlag jump": [jump],
        "hero 50%": [walk],
        "walking": [walk],
        "jumped falling": [jump],
        "50_": [],
        "": [jump, walk],
    }
    for query, expected in kinds.items():
        assert [take.id for take in library.takes(query)[1]] == [one.id for one in expected], query
    assert [take.id for take in library.takes(tag="hero")[1]] == [walk.id]
    assert library.takes(tag="her")[0] == 0
    assert [take.id for take in library.takes(star=False)[1]] == [jump.id]
    assert library.tags() == ["50%", "hero"]


def test_pages_of_the_list_are_newest_first(library: Library) -> None:
    names = [kept(library, WALK).id for _ in range(5)]
    total, found = library.takes(offset=1, limit=2)
    assert (total, [take.id for take in found]) == (5, names[::-1][1:3])


def test_what_is_deleted_can_be_restored(library: Library) -> None:
    take = kept(library, WALK)
    library.change(take.id, deleted=True)
    assert (library.takes()[0], library.takes(deleted=True)[0]) == (0, 1)
    library.change(take.id, deleted=False)
    assert library.take(take.id) == take


def test_a_missing_file_is_told_and_all_else_stays(library: Library) -> None:
    take, file = kept(library, WALK), next((library.folder / "motions").iterdir())
    file.rename(library.folder / "elsewhere")
    assert [one.missing for one in library.takes()[1]] == [True]
    with pytest.raises(MissingMotionError, match=r"is missing.*put the file back"):
        library.motion(take)
    file.write_bytes(b"PK no zip")
    with pytest.raises(MissingMotionError, match="is damaged"):
        library.motion(take)


def test_a_motion_made_again_is_compared_and_restores_its_file(library: Library) -> None:
    take, file = kept(library, WALK), next((library.folder / "motions").iterdir())
    other = Motion(WALK.joints + np.float32(1e-6), caption=WALK.caption)
    assert library.compare(take, WALK) == (True, False)
    assert library.compare(take, other) == (False, False)
    file.unlink()
    assert library.compare(take, other) == (False, False)
    assert not file.exists()
    assert library.compare(take, WALK) == (True, True)
    assert file.exists()


def test_two_studios_may_share_a_library(library: Library) -> None:
    other = Library(library.folder)
    take = kept(other, WALK)
    assert library.take(take.id) == take
    library.change(take.id, star=True)
    assert other.take(take.id).star
    other.close()


def test_unknown_takes_and_characters_are_told(library: Library) -> None:
    with pytest.raises(UnknownError, match="there is no take 'x'"):
        library.take("x")
    with pytest.raises(UnknownError, match="there is no character 'x'"):
        library.change_character("x", deleted=True)


def test_a_folder_that_is_none_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(InputError, match="cannot be written"):
        Library(file)


def test_a_database_of_another_kind_stays_as_it_is(tmp_path: Path) -> None:
    database = tmp_path / "library.sqlite3"
    database.write_bytes(b"a diary" * 100)
    with pytest.raises(InputError, match=r"is no library that can be used .*--library"):
        Library(tmp_path)
    assert database.read_bytes() == b"a diary" * 100


def test_a_library_of_a_later_version_is_refused(tmp_path: Path) -> None:
    Library(tmp_path).close()
    with sqlite3.connect(tmp_path / "library.sqlite3") as database:
        database.execute("PRAGMA user_version = 2")
    database.close()
    with pytest.raises(InputError, match="version 2; update latentmotion"):
        Library(tmp_path)
