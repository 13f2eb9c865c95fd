"""The best of several takes: scored as `best of` does, with its reason in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from latentmotion.motion import Motion
from latentmotion.ranking.best import Take
from latentmotion.studio.takes import reason
from tests.service.conftest import Called
from tests.studio.conftest import made


def take(claims: float = 0.0, text: float = 0.0, sliding: float = 0.0) -> Take:
    motion = Motion(np.zeros((4, 22, 3), "f4"))
    return Take(motion, 0.0, claims, text, sliding, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("first", "words"),
    [
        (take(claims=1.0), "counts and turns as the prompt says"),
        (take(text=0.2), "closest to the prompt"),
        (take(sliding=-0.1, text=0.2), "closest to the prompt, feet slide less"),
        (take(text=0.001), "all are close"),
    ],
)
def test_the_reason_is_what_the_first_does_better(first: Take, words: str) -> None:
    assert reason([first, take(), take()]) == words
    assert reason([first]) == "the only one"


def asked(studio: Called, takes: list[dict[str, Any]]) -> dict[str, Any]:
    query = "&".join(f"take={one['id']}" for one in takes)
    return studio.get(f"/studio/v1/best?{query}").json()


def test_takes_of_a_prompt_are_scored(studio: Called) -> None:
    takes = made(studio, 3, prompt="a person walks forward", seconds=2)
    found = asked(studio, takes)
    assert set(found["scores"]) == {one["id"] for one in takes}
    assert found["take"] == max(found["scores"], key=found["scores"].__getitem__)
    assert found["reason"]


def test_takes_of_several_prompts_have_no_best(studio: Called) -> None:
    takes = made(studio, prompt="a person walks", seconds=2)
    takes += made(studio, prompt="a person jumps", seconds=2)
    assert asked(studio, takes) == {"take": None, "reason": "", "scores": {}}
    assert studio.get("/studio/v1/best?take=01M83KC31REF7RP72GNKH69SHQ").status_code == 404
