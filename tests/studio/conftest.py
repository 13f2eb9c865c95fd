"""A studio in this process, and a library without a model."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from latentmotion import Motion
from latentmotion.service.settings import Settings
from latentmotion.studio.app import create_studio
from latentmotion.studio.library import Edits, Library, StoredTake
from tests.service.conftest import TOKEN, Called, calling, serving

SETTINGS = Settings(file_workers=1, tokens=(hashlib.sha256(TOKEN.encode()).digest(),))


@pytest.fixture(scope="session")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Called]:
    library = Library(tmp_path_factory.mktemp("library"))
    app = create_studio(SETTINGS, library)
    with calling(serving(SETTINGS, app=app, token=TOKEN)) as called:
        called.library = library
        yield called


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A studio that never starts."""
    library = Library(tmp_path_factory.mktemp("library"))
    yield create_studio(SETTINGS, library)
    library.close()


@pytest.fixture
def library(tmp_path: Path) -> Iterator[Library]:
    library = Library(tmp_path / "library")
    yield library
    library.close()


def kept(library: Library, motion: Motion, **recipe: Any) -> StoredTake:
    """Returns the take of a motion that is put into a library."""
    edits = Edits()
    (take,) = library.add([(motion, {"prompt": motion.caption, **recipe}, motion.caption, edits)])
    return take


def made(studio: Called, takes: int = 1, **recipe: Any) -> list[dict[str, Any]]:
    """Returns takes that a studio makes of a recipe."""
    answer = studio.post("/studio/v1/takes", {"recipe": recipe, "takes": takes})
    assert answer.status_code == 200, answer.text
    return answer.json()["takes"]
