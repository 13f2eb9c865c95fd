"""Recipes: each kind makes its motion again to the bit, whatever became of the takes it used."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.studio.making import Maker
from tests.service.conftest import Called
from tests.studio.conftest import made

pytestmark = pytest.mark.filterwarnings("ignore::latentmotion.cleanup.pipeline.CleanUpWarning")

WALK = {"prompt": "a person walks forward", "seconds": 2.0, "steps": 1}
SPANS = [{"prompt": "a person walks", "seconds": 1.6}, {"prompt": "a person jumps", "seconds": 1.2}]
PART = {"part": "right_arm", "prompt": "a person waves", "start": 1.0, "end": 2.0}
KINDS: dict[str, dict[str, Any]] = {
    "prompt": WALK,
    "unclean": {**WALK, "clean": False, "guidance": 3.0},
    "predicted length": {"prompt": "a person waves", "steps": 1},
    "best of several": {**WALK, "best_of": 2},
    "exact count": {"prompt": "a person bows twice"},
    "inexact count": {"prompt": "a person bows twice", "exact_count": False},
    "exact turn": {"prompt": "turn around to the left", "steps": 4},
    "inexact turn": {"prompt": "turn around to the left", "steps": 4, "exact_turn": False},
    "goals": {**WALK, "goals": [{"joint": "right_wrist", "at": 1.5, "to": [None, 1.4, None]}]},
    "path": {**WALK, "path": {"points": [[0, 0], [0, 1], [0.5, 2]]}},
    "timeline": {"timeline": SPANS, "steps": 2},
    "timeline with a part": {"timeline": SPANS, "timeline_parts": [PART], "steps": 2},
    "loop": {**WALK, "loop": True, "steps": 2},
    "start": {**WALK, "start": "A"},
    "poses": {**WALK, "poses": [{"at": 1.0, "take": "A", "frame": -1}]},
    "edit": {
        **{"prompt": "a person waves", "steps": 1},
        "edit": {"take": "A", "between": [0.4, 1.2], "parts": ["left_arm"]},
    },
    "transition": {"between": {"start": "A", "end": "B"}, "seconds": 1.0, "steps": 1},
}


@pytest.fixture(scope="module")
def sources(studio: Called) -> dict[str, str]:
    found = made(studio, 2, **WALK)
    return {"A": found[0]["id"], "B": found[1]["id"]}


def filled(value: Any, names: dict[str, str]) -> Any:
    """Returns a recipe with the names of takes."""
    if isinstance(value, dict):
        return {key: filled(item, names) for key, item in value.items()}
    if isinstance(value, list):
        return [filled(item, names) for item in value]
    return names.get(value, value) if isinstance(value, str) else value


@pytest.mark.parametrize("kind", KINDS)
def test_takes_are_made_again_to_the_bit(
    studio: Called, sources: dict[str, str], kind: str
) -> None:
    (take,) = made(studio, seed=3, **filled(KINDS[kind], sources))
    for name in sources.values():  # edits and deletion of what it used come later
        studio.send("PATCH", f"/studio/v1/takes/{name}", {"trim": [0.2, 1.0], "mirrored": True})
        studio.send("DELETE", f"/studio/v1/takes/{name}")
    answer = studio.post(f"/studio/v1/takes/{take['id']}/again").json()
    for name in sources.values():
        studio.send("PATCH", f"/studio/v1/takes/{name}", {"trim": None, "mirrored": False})
        studio.post(f"/studio/v1/takes/{name}/restore")
    assert answer == {"equal": True, "restored": False}
    assert take["recipe"]["model"] == "fast"
    assert len(take["recipe"]["weights"]) == 64


def test_takes_of_one_batch_are_made_again_to_the_bit(studio: Called) -> None:
    for take in made(studio, 4, prompt="a person walks forward"):
        answer = studio.post(f"/studio/v1/takes/{take['id']}/again").json()
        assert answer == {"equal": True, "restored": False}


@pytest.mark.parametrize(
    ("prompt", "option"),
    [("turn around to the left", "exact_turn"), ("a person bows twice", "exact_count")],
)
def test_takes_that_do_not_tell_of_exact_turns_and_counts_have_none(
    studio: Called, prompt: str, option: str
) -> None:
    asked = {"prompt": prompt, "steps": 4, "seed": 1}
    (exact,), (plain,) = made(studio, 1, **asked), made(studio, 1, **asked, **{option: False})
    one, other = (joints_of(studio, take["id"]) for take in (exact, plain))
    assert one.shape != other.shape or not np.allclose(one, other)
    old = {name: it for name, it in plain["recipe"].items() if name != option}
    library = studio.library
    maker = Maker(studio.service.pipeline, plain["recipe"]["weights"], library)
    np.testing.assert_array_equal(maker.again(old).joints, joints_of(studio, plain["id"]))


def test_takes_of_a_prompt_are_one_batch_and_each_is_as_alone(
    studio: Called, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches: list[int] = []
    batch = MotionPipeline.batch

    def counted(self: MotionPipeline, prompts: Any, *options: Any) -> Any:
        batches.append(len(prompts))
        return batch(self, prompts, *options)

    monkeypatch.setattr(MotionPipeline, "batch", counted)
    takes = made(studio, 4, seed=7, **WALK)
    assert batches == [4]
    assert [take["recipe"]["seed"] for take in takes] == [7, 8, 9, 10]
    alone = studio.service.pipeline(WALK["prompt"], 2.0, 9, 1, takes=1)
    np.testing.assert_array_equal(joints_of(studio, takes[2]["id"]), alone.joints)


def test_a_start_is_the_last_pose_turned_ahead(studio: Called, sources: dict[str, str]) -> None:
    (take,) = made(studio, seed=1, **filled(KINDS["start"], sources))
    own, last = joints_of(studio, take["id"])[0], joints_of(studio, sources["A"])[-1]
    np.testing.assert_allclose(own[0, [0, 2]], 0, atol=1e-3)
    between = [np.linalg.norm(pose[:, None] - pose, axis=-1) for pose in (own, last)]
    np.testing.assert_allclose(*between, atol=0.02)


def test_goals_are_told_with_what_they_missed(studio: Called) -> None:
    (take,) = made(studio, **KINDS["goals"])
    (goal,) = take["goals"]
    assert goal["goal"] == {"joint": "right_wrist", "at": 1.5, "to": [None, 1.4, None]}
    assert goal["after_cm"] < 0.1
    assert joints_of(studio, take["id"])[30, 21, 1] == pytest.approx(1.4, abs=1e-3)


def test_a_recipe_of_a_take_may_be_sent_again(studio: Called) -> None:
    (take,) = made(studio, seed=5, **WALK)
    (other,) = made(studio, **take["recipe"])
    assert other["motion"] == take["motion"]
    assert other["recipe"] == take["recipe"]


@pytest.mark.parametrize(
    ("recipe", "told"),
    [
        ({"prompt": ""}, "the sentence is empty"),
        ({**WALK, "seconds": 99}, "0.6 to 9.8 seconds"),
        ({**WALK, "steps": 3}, "takes 1, 2, 4"),
        ({**WALK, "timeline": SPANS}, "a timeline has no prompt, length or goals"),
        ({"timeline": SPANS, "loop": True}, "a timeline and a loop; expected one of them"),
        ({**WALK, "timeline_parts": [PART]}, "timeline_parts needs a timeline"),
        ({"timeline": SPANS, "best_of": 2}, "a timeline takes no goals"),
        ({**KINDS["edit"], "seconds": 2}, "as long as the part"),
        ({**WALK, "goals": [{"joint": "hand", "at": 1, "to": [0, 1, 0]}]}, "hand"),
        ({**KINDS["edit"], "edit": {"take": "A", "between": [0, 1], "parts": ["tail"]}}, "tail"),
        ({**WALK, "start": "../../etc/passwd"}, "expected the name of a take"),
        ({**WALK, "file": "x"}, "file"),
    ],
)
def test_a_recipe_that_cannot_be_met_says_why(
    studio: Called, sources: dict[str, str], recipe: dict[str, Any], told: str
) -> None:
    body = {"recipe": filled(recipe, sources), "takes": 1}
    answer = studio.post("/studio/v1/takes", body)
    assert answer.status_code == 422
    assert told in answer.json()["detail"]


def test_a_take_whose_model_is_absent_says_so(
    studio: Called, monkeypatch: pytest.MonkeyPatch
) -> None:
    (take,) = made(studio, **WALK)
    library = studio.library
    own = library.take(take["id"])
    other = type(own)(**vars(own) | {"recipe": {**own.recipe, "weights": "0" * 64}})
    monkeypatch.setattr(library, "take", lambda name: other)
    answer = studio.post(f"/studio/v1/takes/{take['id']}/again")
    assert answer.status_code == 422
    assert "made by model 'fast', whose weights (SHA-256 000000000000…)" in answer.json()["detail"]
    assert "latentmotion studio --model FOLDER" in answer.json()["detail"]


def joints_of(studio: Called, name: str) -> np.ndarray:
    """Returns the joints of a take as its answer holds them."""
    answer = studio.get(f"/studio/v1/takes/{name}/joints")
    frames = int(answer.headers["x-frames"])
    return np.frombuffer(answer.content, "<f4").reshape(frames, 22, 3)
