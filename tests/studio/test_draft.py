"""What the studio's page makes of a take's recipe, by its script alone; needs Node."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

NODE = shutil.which("node")
DRAFT = Path(__file__).parents[2] / "src/latentmotion/viewer/source/studio/draft.js"
PROGRAM = """
const { readFileSync } = await import("node:fs");
const text = readFileSync(process.argv[1], "utf8");
const { draftOf, emptyDraft, recipeOf, takesGoals, wordsOfKept } =
  await import("data:text/javascript;base64," + Buffer.from(text).toString("base64"));
const usual = emptyDraft({ model: "fast", usual_steps: 4, guidance: { usual: 2 } });
const draft = draftOf(JSON.parse(process.argv[2]), usual);
const told = { recipe: recipeOf(draft), words: wordsOfKept(draft), goals: takesGoals(draft) };
console.log(JSON.stringify(told));
"""
CLEANING = {"clean": True, "exact_turn": True, "exact_count": True}
SETTINGS = {"format": 1, "seed": 7, "steps": 4, "guidance": 2, **CLEANING}
WAVE = {"part": "right_arm", "prompt": "a person waves", "start": 1, "end": 2}
WALK, JUMP = ({"prompt": text, "seconds": 3} for text in ("a person walks", "a person jumps"))

pytestmark = pytest.mark.skipif(
    NODE is None, reason="needs Node.js (Debian: apt-get install nodejs npm)"
)


def opened(recipe: dict[str, Any]) -> dict[str, Any]:
    """A recipe as the page asks for it after it was opened."""
    assert NODE is not None
    command = [NODE, "--input-type=module", "-e", PROGRAM, str(DRAFT), json.dumps(recipe)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.parametrize(
    "recipe",
    [
        {"prompt": "a person walks", "seconds": 3, "path": {"points": [[0, 0], [0, 2]]}},
        {"timeline": [WALK, JUMP]},
        {"timeline": [WALK, JUMP], "timeline_parts": [WAVE]},
        {"timeline": [WALK], "timeline_parts": [WAVE]},
        {"prompt": "a person walks", "seconds": 3, "in_place": True, "sampler": "heun"},
    ],
)
def test_an_opened_take_is_asked_for_again_as_it_was(recipe):
    assert opened(SETTINGS | recipe)["recipe"] == SETTINGS | recipe


def test_parts_of_the_body_are_told_and_take_no_goals():
    told = opened(SETTINGS | {"timeline": [WALK], "timeline_parts": [WAVE, WAVE]})
    assert told["words"] == "2 prompts for parts of the body (right arm)"
    assert not told["goals"]
