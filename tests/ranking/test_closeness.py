"""Grades of motions of known truth: the nearer to what is asked, the higher."""

from __future__ import annotations

import numpy as np
import pytest

from latentmotion.language.reading import request_of
from latentmotion.measure.scene import describe
from latentmotion.ranking.closeness import closeness
from tests.support import acted


def grade(prompt: str, name: str) -> float:
    return closeness(request_of(prompt), acted.scene(name))


@pytest.mark.parametrize(
    ("name", "better", "worse"),
    [
        ("turn left", "turn 90 degrees to the left", "turn 45 degrees to the left"),
        ("turn left", "a quarter turn left", "turn around to the left"),
        ("turn left", "turn left", "turn right"),
        ("turn around", "do a one-eighty", "do a 360"),
        ("turn around", "turn halfway around to the right", "turn right by 90 degrees"),
        ("walk a circle", "walk in a circle to the right", "walk in a circle to the left"),
        ("walk a circle", "walk in a circle", "walk a half circle"),
        ("kick to the side", "kick twice", "kick once"),
        ("kick to the side", "kick with the right foot", "kick with the left foot"),
        ("hop twice", "two hops on the right leg", "four hops on the right leg"),
        ("punch", "two punches", "punch once"),
        ("three steps", "three steps forward", "take one step forward"),
        ("three steps", "three steps forward", "three steps backward"),
        ("jack", "two jumping jacks", "four jumping jacks"),
        ("wave", "wave with the right hand", "wave with the left hand"),
        ("raise a hand", "raise the left hand", "wave with the left hand"),
        ("walk, then wave", "walk, then wave", "wave, then walk"),
        ("wave, then walk", "wave, then walk", "walk up and wave"),
        ("walk, then sit down", "sit down after walking", "sit down, then walk"),
        ("turn, then walk", "turn left, then walk", "walk, then turn left"),
        ("walk slowly", "walk slowly", "walk fast"),
        ("walk fast", "walk briskly", "walk slowly"),
        ("run", "run fast", "walk"),
        ("walk to the left", "walk sideways to the left", "walk straight ahead"),
        ("walk and stop", "walk, then stop", "stop, then walk"),
        ("walk and stop", "slow down", "speed up"),
        ("stand", "stand still", "march in place"),
        ("march", "march in place", "walk forward"),
        ("crouch", "crouch", "kneel"),
        ("sit down", "sit down", "get up from a chair"),
        ("crawl", "crawl on all fours", "jump forward"),
        ("lie down", "sleep on the floor", "sit on the floor"),
    ],
)
def test_the_nearer_claim_is_graded_higher(name: str, better: str, worse: str) -> None:
    assert 1 >= grade(better, name) > grade(worse, name) + 0.1 >= 0.1


def test_degrees_count_gradually() -> None:
    grades = [grade(f"turn {n} degrees to the left", "turn left") for n in (90, 70, 45)]
    assert grades[0] > grades[1] > grades[2]


def test_nothing_asked_is_zero() -> None:
    assert grade("a person juggles", "walk") == 0.0


def test_place_and_heading_do_not_matter() -> None:
    joints = acted.scene("walk, then wave").signals.joints
    moved = joints * np.array([-1, 1, -1]) + np.array([3.0, 0, 5.0])
    request = request_of("walk, then wave")
    assert closeness(request, describe(moved)) == pytest.approx(
        closeness(request, describe(joints))
    )
