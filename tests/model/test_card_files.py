"""What is published beside a card: the schema of model.json, and the page for the hub."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest
import yaml

from latentmotion.errors import ModelError
from latentmotion.export.package import readme
from latentmotion.model.card import (
    CARD_FILE,
    SCHEMA_FILE,
    ModelCard,
    find_model,
    read_card,
    shipped_models,
)
from latentmotion.storage.configuration import from_json
from tests.support.schemas import json_schema

SCHEMA = json.loads(SCHEMA_FILE.read_text(encoding="utf-8"))


def shipped(name: str) -> dict[str, Any]:
    return json.loads((find_model(name) / CARD_FILE).read_text(encoding="utf-8"))


def test_the_published_schema_is_the_readers() -> None:
    found = json_schema(ModelCard, "Model card")
    assert found == SCHEMA, (
        "write it anew: from latentmotion.model.card import *; SCHEMA_FILE.write_text("
        "json.dumps(json_schema(ModelCard, 'Model card'), indent=1) + '\\n')"
    )
    assert jsonschema_rs.meta.is_valid(SCHEMA)


@pytest.mark.parametrize("name", shipped_models())
def test_shipped_cards_fit_the_schema_and_come_back_as_written(name: str, tmp_path: Path) -> None:
    jsonschema_rs.validate(SCHEMA, shipped(name))
    card = read_card(find_model(name))
    card.write(tmp_path)
    assert read_card(tmp_path) == card and shipped(name)["format"] == 2


def _lacking(card: dict[str, Any]) -> None:
    del card["representation"]


def _misspelled(card: dict[str, Any]) -> None:
    card["sampling"]["stepz"] = 4


def _of_another_kind(card: dict[str, Any]) -> None:
    card["schedule"] = {"kind": "Square"}


def _without_kind(card: dict[str, Any]) -> None:
    del card["vae"]["kind"]


def _of_another_type(card: dict[str, Any]) -> None:
    card["frames"] = [12, "many"]


def _one_too_many(card: dict[str, Any]) -> None:
    card["frames"].append(3)


def _no_choice(card: dict[str, Any]) -> None:
    card["precision"] = "int4"


@pytest.mark.parametrize(
    "damage",
    [
        *(_lacking, _misspelled, _of_another_kind, _without_kind),
        *(_of_another_type, _one_too_many, _no_choice),
    ],
)
def test_schema_and_reader_refuse_the_same(damage: Any, tmp_path) -> None:
    card = shipped("fast")
    damage(card)
    assert not jsonschema_rs.is_valid(SCHEMA, card)
    (tmp_path / CARD_FILE).write_text(json.dumps(card))
    with pytest.raises(ModelError):
        read_card(tmp_path)


def test_the_page_for_the_hub_names_terms_data_and_figures() -> None:
    card = read_card(find_model("starter"))
    card = replace(card, figures={"instructions": {"all": 0.77}, "teacher": "none"})
    _, head, page = readme(card).split("---\n", 2)
    fields = yaml.safe_load(head)
    assert fields["license"] == "cc-by-sa-3.0" and fields["datasets"][0] == "cmu"
    assert (fields["pipeline_tag"], fields["library_name"]) == ("text-to-3d", "latentmotion")
    (model,) = fields["model-index"]
    assert model["name"] == "starter"
    assert model["results"][0]["metrics"] == [
        {"type": "all", "name": "instructions.all", "value": 0.77}
    ]
    assert "| instructions.all | 0.77 |" in page and card.provenance.commands[0] in page


def test_the_page_of_a_bare_card_has_no_empty_fields() -> None:
    bare = {key: value for key, value in shipped("starter").items() if key != "provenance"}
    page = readme(from_json(ModelCard, bare | {"figures": {}}))
    assert "None were measured." in page and "model-index" not in page and "null" not in page
