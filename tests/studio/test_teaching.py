"""Teaching in the studio: takes of a sentence start from a take that shows it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from latentmotion.studio.app import create_studio
from latentmotion.studio.library import Library
from tests.service.conftest import TOKEN, Called, calling, serving
from tests.studio.conftest import SETTINGS, made

SHOWN, NEW = "a person jumps", "a person balances on one leg"


def clips_of(called: Any, takes: list[dict[str, Any]]) -> list[Any]:
    """Returns the clips that takes started from."""
    motions = [called.library.motion(called.library.take(take["id"])) for take in takes]
    return [motion.metadata.get("from_clips", []) for motion in motions]


def test_a_take_teaches_its_sentences_at_once_and_after_a_restart(tmp_path: Path) -> None:
    for start in range(2):
        library = Library(tmp_path / "library")
        app = create_studio(SETTINGS, library)
        with calling(serving(SETTINGS, app=app, token=TOKEN)) as called:
            called.library = library
            if not start:
                (take,) = made(called, prompt=SHOWN, seconds=2)
                before = clips_of(called, made(called, prompt=NEW))
                assert take["id"] not in str(before)
                body = {"sentences": [NEW, " ", "a spider person climbs"]}
                answer = called.post(f"/studio/v1/takes/{take['id']}/teach", body)
                assert answer.json() == {"clips": 1, "sentences": 2}
            assert take["id"] in str(clips_of(called, made(called, prompt=NEW)))


def test_a_take_without_a_sentence_teaches_nothing(studio: Called) -> None:
    (take,) = made(studio, prompt=SHOWN, seconds=2)
    for sentences in ([], ["  "]):
        answer = studio.post(f"/studio/v1/takes/{take['id']}/teach", {"sentences": sentences})
        assert answer.status_code == 422
    assert not (studio.library.folder / "moves").exists()
