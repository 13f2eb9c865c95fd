"""Laws of the describer: where the floor's axes point does not matter, left and right are alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from latentmotion.data.clip import mirror_words
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.language.claims import Claim
from latentmotion.language.reading import claims_of
from latentmotion.measure.facts import Description
from latentmotion.measure.scene import describe
from latentmotion.ranking.agreement import check
from latentmotion.training.captioning.described import holds
from latentmotion.training.captioning.sentences import sentences
from tests.support.simple_motions import figure, mirrored, raised

MOTIONS = {
    "standing": figure(3),
    "walking": figure(4, speed=1.0),
    "running": figure(4, speed=2.4),
    "backwards": figure(3, speed=0.9, way=180),
    "sideways": figure(3, speed=0.9, way=90),
    "turning": figure(4, turn=180),
    "a curve": figure(5, speed=1.0, turn=120),
    "a circle": figure(8, speed=1.1, turn=360),
    "a raised arm": figure(3, swings={"left_shoulder": raised(60, 2.6)}),
    "both arms": figure(
        3, swings={"left_shoulder": raised(60, 2.6), "right_shoulder": raised(60, -2.6)}
    ),
}
SWAPPED = {"left": "right", "right": "left"}
SENTENCES = (
    "a person walks forward and turns left",
    "someone kicks twice with the right foot",
    "a man raises the left hand, then waves with it",
    "she walks in a circle to the right",
    "he steps to the left, then jumps",
    "a person turns right by 90 degrees and stops",
    "a person stands on one leg",
    "a person punches with the left hand three times",
)


def kinds(found: Description) -> list[tuple[str, str, str, int]]:
    """All facts but their measures and frames."""
    every = [*found.moves, *found.turns, *found.events]
    return sorted((fact.kind, fact.side, fact.direction, fact.count) for fact in every)


@pytest.mark.parametrize("heading", [40, 90, 180, 270])
@pytest.mark.parametrize("name", MOTIONS)
def test_it_does_not_matter_where_it_happens(name: str, heading: float) -> None:
    turn = matrix_from_axis_angle(np.array([0, np.radians(heading), 0]))
    elsewhere = MOTIONS[name] @ turn.T + np.array([3.0, 0.0, -7.0])
    one, other = describe(MOTIONS[name]), describe(elsewhere)
    assert kinds(one) == kinds(other)
    assert one.path.forward == pytest.approx(other.path.forward, abs=1e-6)
    assert one.path.left == pytest.approx(other.path.left, abs=1e-6)
    assert one.path.turned == pytest.approx(other.path.turned, abs=1e-6)


@pytest.mark.parametrize("name", MOTIONS)
def test_a_mirrored_figure_goes_as_far_to_the_other_side(name: str) -> None:
    one, other = describe(MOTIONS[name]), describe(mirrored(MOTIONS[name]))
    assert other.path.forward == pytest.approx(one.path.forward, abs=1e-6)
    assert other.path.left == pytest.approx(-one.path.left, abs=1e-6)
    assert other.path.turned == pytest.approx(-one.path.turned, abs=1e-6)
    swapped = [
        (kind, SWAPPED.get(side, side), SWAPPED.get(direction, direction), count)
        for kind, side, direction, count in kinds(one)
    ]
    assert kinds(other) == sorted(swapped)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", MOTIONS)
def test_its_own_sentences_are_never_contradicted(name: str, seed: int) -> None:
    found = describe(MOTIONS[name])
    for sentence in sentences(found, np.random.default_rng(seed), count=8):
        assert check(sentence, found).verdict != "contradicts", sentence


@pytest.mark.parametrize("name", [name for name in MOTIONS if name != "standing"])
def test_its_own_sentences_are_not_those_of_who_stands_still(name: str) -> None:
    found, standing = describe(MOTIONS[name]), describe(MOTIONS["standing"])
    told = sentences(found, np.random.default_rng(0), count=8)
    verdicts = {check(sentence, standing).verdict for sentence in told}
    assert "agrees" not in verdicts


@pytest.mark.parametrize("sentence", SENTENCES)
def test_mirrored_words_claim_the_mirrored_motion(sentence: str) -> None:
    def swapped(claim: Claim) -> Claim:
        side, direction = claim.side, claim.direction
        return replace(
            claim, side=SWAPPED.get(side, side), direction=SWAPPED.get(direction, direction)
        )

    found = list(claims_of(sentence))
    assert found, sentence
    assert list(claims_of(mirror_words(sentence))) == [swapped(claim) for claim in found]


@pytest.mark.parametrize("sentence", SENTENCES)
def test_capitals_and_spaces_claim_nothing_else(sentence: str) -> None:
    assert claims_of(f"  {sentence.capitalize()}.  ") == claims_of(sentence)


def test_a_caption_holds_of_the_part_where_it_happens() -> None:
    walk, stay = MOTIONS["walking"], figure(4)
    stay = stay + (walk[-1, :1] - stay[:1, :1]) * np.array([1, 0, 1])
    whole = describe(np.concatenate([walk, stay]))
    assert holds("a person walks forward", whole, describe(walk))
    assert not holds("a person walks forward", whole, describe(stay))
    assert not holds("a person plays the violin and jumps", whole, describe(stay[:30]))
