"""Licenses and credits: the package, the cards, the folders of weights, files and answers agree."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from latentmotion import MotionPipeline
from latentmotion.formats.gltf_document import Document
from latentmotion.model.card import MOVES_FILE, RIGHTS_IN_MOTIONS, SHIPPED
from latentmotion.retrieval.index import read_index
from tests.service.conftest import Called

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CARDS = {
    path.parent.name: json.loads(path.read_text())["provenance"]
    for path in (*SHIPPED.glob("*/model.json"), *SHIPPED.glob("*/scorer.json"))
}
WEIGHTS = {"CC BY-SA 3.0 Unported": "CC-BY-SA-3.0"}  # SPDX's names of the licenses of weights.

# What the owners of data sets ask for, by the names in the cards.
CREDITS = {
    "cmu": "obtained from mocap.cs.cmu.edu",
    "snu": "Movement Research Lab, Seoul National University",
    "hdm05": "Documentation Mocap Database HDM05",
    "composed": "",
    "holosoma": "Amazon FAR (Holosoma)",
    "snu_more": "Movement Research Lab, Seoul National University",
    "animated": "Meta Platforms, Inc. (AnimatedDrawings)",
    "gestures": "gestures drawn on a recording of SNU's",
}

TEXTS = {
    "LICENSE-Apache-2.0.txt": ("Version 2.0, January 2004", "END OF TERMS AND CONDITIONS"),
    "LICENSE-AnimatedDrawings.txt": (
        "Copyright (c) Meta Platforms",
        "Permission is hereby granted",
    ),
    "LICENSE-HumanML3D.txt": ("Copyright (c) 2022 Chuan Guo", "Permission is hereby granted"),
}


def plain(text: str) -> str:
    return re.sub(r"\s+", " ", text)


@pytest.mark.parametrize("name", CARDS)
def test_a_folder_of_weights_credits_what_its_card_names(name: str) -> None:
    text, card = plain((SHIPPED / name / "LICENSE.md").read_text("utf-8")), CARDS[name]
    assert card["license"] in WEIGHTS and "CC BY-SA 3.0" in text
    named = [source.partition(":")[0] for source in card["data"]]
    assert set(named) <= CREDITS.keys() and {"cmu", "snu", "hdm05"} <= set(named)
    for source in named:
        assert CREDITS[source] in text, f"{source} is not credited"
    for credit in ("HumanML3D, MIT, © 2022 Chuan Guo", "all-MiniLM-L6-v2, Apache-2.0", "changed"):
        assert credit in text
    others = {"LICENSE-AnimatedDrawings.txt"} if "animated" not in named else set()
    for file in TEXTS.keys() - others:
        assert f"../{file}" in text


def test_the_owners_of_the_clips_that_motions_start_from_are_credited() -> None:
    text = plain((SHIPPED / "starter" / "LICENSE.md").read_text("utf-8"))
    for source in read_index(SHIPPED / "starter" / MOVES_FILE).sources:
        assert CREDITS[source.name] in text, f"{source.name} is not credited"


def test_the_texts_of_licenses_are_there_and_packed() -> None:
    packed = {path for pattern in PROJECT["license-files"] for path in ROOT.glob(pattern)}
    for file, parts in TEXTS.items():
        text = (SHIPPED / file).read_text("utf-8")
        assert all(part in text for part in parts)
        assert SHIPPED / file in packed
    assert {SHIPPED / name / "LICENSE.md" for name in CARDS} <= packed
    assert {ROOT / "LICENSE", *ROOT.glob("src/**/LICENSES.txt")} <= packed


def test_the_expression_names_every_license_inside() -> None:
    named = set(PROJECT["license"].split(" AND "))
    assert named == {"MIT", "Apache-2.0", *(WEIGHTS[card["license"]] for card in CARDS.values())}
    recipe = (ROOT / "recipe" / "meta.yaml").read_text()
    (told,) = re.findall(r"^\s+license: (.*)$", recipe, re.M)
    assert told.strip() == PROJECT["license"]
    web = json.loads((ROOT / "packages" / "web" / "package.json").read_text())
    assert (web["license"], web["files"]) == ("MIT", ["src", "README.md"]), "it holds no weights"


def test_motions_files_and_answers_say_the_same(called: Called, tmp_path: Path) -> None:
    weights = CARDS["starter"]["license"]
    expected = {"rights": RIGHTS_IN_MOTIONS, "weights_license": weights}
    motion = MotionPipeline.from_pretrained()("a person walks", seconds=1)
    assert expected.items() <= motion.metadata.items()
    motion.save(tmp_path / "a.glb")
    extras: Any = Document.read(tmp_path / "a.glb").json["animations"][0]["extras"]
    assert expected.items() <= extras.items()
    answer = called.post("/v1/motions", {"prompt": "a person walks", "seconds": 1})
    assert answer.headers["LatentMotion-License"] == weights
    assert answer.headers["LatentMotion-Rights"] == RIGHTS_IN_MOTIONS
    assert called.get("/v1/models").json()[0]["license"] == weights
