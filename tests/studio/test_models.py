"""Models of the studio: chosen for the next takes, two in memory, found again by their weights."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from latentmotion.errors import InputError
from latentmotion.model.card import CARD_FILE, SHIPPED
from latentmotion.studio.models import Models
from tests.service.conftest import Called
from tests.studio.conftest import made

WALK = {"prompt": "a person walks forward", "seconds": 1.0, "steps": 2}


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """The starter in a folder and under a name of its own."""
    folder = tmp_path / "copied"
    folder.mkdir()
    for file in (SHIPPED / "starter").iterdir():
        (folder / file.name).symlink_to(file)
    card = json.loads((folder / CARD_FILE).read_text("utf-8"))
    (folder / CARD_FILE).unlink()
    (folder / CARD_FILE).write_text(json.dumps({**card, "name": "copied"}), "utf-8")
    return folder


@pytest.fixture
def models(studio: Called, copied: Path) -> Models:
    library = studio.library
    return Models(studio.service, library, [str(copied)])


def loaded(models: Models) -> list[str]:
    return [name for name, model in models.all.items() if models.is_loaded(model)]


def test_models_are_listed_with_what_each_can_do(studio: Called) -> None:
    fast, starter = studio.get("/studio/v1/models").json()["models"]
    assert (fast["name"], fast["loaded"], starter["name"]) == ("fast", True, "starter")
    assert fast["capabilities"] == studio.get("/studio/v1/capabilities").json()
    assert fast["capabilities"]["models"] == ["fast", "starter"]
    assert starter["capabilities"]["usual_steps"] in starter["capabilities"]["steps"]
    assert starter["capabilities"]["steps"][-1] > 4
    assert fast["weights"] != starter["weights"]


def test_takes_of_another_model_keep_it_and_are_made_again_by_it(studio: Called) -> None:
    answer = studio.post("/studio/v1/models", {"model": "starter"})
    assert answer.json()["loaded"]
    body = {"recipe": {**WALK, "seed": 5}, "takes": 1, "model": "starter"}
    (take,) = studio.post("/studio/v1/takes", body).json()["takes"]
    assert take["recipe"]["model"] == "starter"
    assert take["recipe"]["weights"] == answer.json()["weights"]
    (other,) = made(studio, **WALK, seed=5)
    assert other["recipe"]["model"] == "fast"
    assert other["motion"] != take["motion"]
    for one in (take, other):
        again = studio.post(f"/studio/v1/takes/{one['id']}/again").json()
        assert again == {"equal": True, "restored": False}


def test_two_models_are_in_memory_at_most(models: Models) -> None:
    assert list(models.all) == ["fast", "copied", "starter"]
    assert loaded(models) == ["fast"]
    first = models.maker("copied")
    assert models.maker("copied") is first
    assert loaded(models) == ["fast", "copied"]
    models.maker("starter")
    assert loaded(models) == ["fast", "starter"]
    assert models.maker().pipeline is models.service.pipeline


def test_a_take_is_made_again_by_whoever_has_its_weights(models: Models) -> None:
    recipe = {"model": "another name", "weights": models.all["starter"].weights}
    assert models.maker_again(recipe).pipeline.card.name in ("copied", "starter")


def test_a_model_that_is_not_there_is_told(studio: Called) -> None:
    for path, body in (("takes", {"recipe": WALK}), ("models", {})):
        answer = studio.post(f"/studio/v1/{path}", {**body, "model": "startr"})
        assert answer.status_code == 422
        assert "no model 'startr' in this studio; did you mean 'starter'?" in answer.text


def test_a_model_of_another_skeleton_is_refused(
    studio: Called, copied: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = Models.opened

    def other(self: Models, model: Any) -> Any:
        if model.name != "copied":
            return opened(self, model)
        space = SimpleNamespace(skeleton=SimpleNamespace(names=("root", "tail")))
        return SimpleNamespace(representation=space)

    monkeypatch.setattr(Models, "opened", other)
    library = studio.library
    with pytest.raises(InputError, match="moves 2 joints, others than the 22 of 'fast'"):
        Models(studio.service, library, [str(copied)])
