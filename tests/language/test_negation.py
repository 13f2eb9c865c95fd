"""Negated clauses: they claim nothing, and are not given to the text encoder."""

from __future__ import annotations

import pytest

from latentmotion.language.claims import NO_CORRECTIONS
from latentmotion.language.reading import affirmed, asked_exactly, claims_of, request_of


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("a person walks", "a person walks"),
        ("a person does not sit down", "a person stands"),
        ("she doesn't get up from her seat", "a person stays seated"),
        ("he never leaves the chair", "a person stays seated"),
        ("he does not sit on the chair", "a person stands"),
        ("never turn around, walk straight", "walk straight"),
        ("walk but do not turn", "walk"),
        ("a person stands without raising the arms", "a person stands"),
        ("don't walk, just wave with your left hand", "wave with your left hand"),
        ("a man who doesn't kneel and bows", "a man who bows"),
        ("a person walks; then he doesn’t jump.", "a person walks"),
        ("walks, doesn't run and then sits", "walks, then sits"),
        ("A Person WALKS, not fast, and waves", "A Person WALKS, and waves"),
        ("he avoids stepping on the lawn.", "a person stands"),
        ("he avoids a snowball", "he avoids a snowball"),
        ("strolls about with no goal", "strolls about"),
        ("strikes a T-pose without moving the man's legs", "strikes a T-pose"),
        ("stands still, no movement at all", "stands still, no movement at all"),
        ("don't move at all", "don't move at all"),
        ("he can't stop laughing", "he can't stop laughing"),
        ("a person doesn't stop and walks", "a person walks"),
        ("shakes his head no and crosses his arms", "shakes his head no and crosses his arms"),
        ("", ""),
    ],
)
def test_what_is_left_of_a_sentence(sentence: str, said: str) -> None:
    assert affirmed(sentence) == said
    assert affirmed(said) == said


@pytest.mark.parametrize(
    ("sentence", "kinds"),
    [
        ("a person does not sit down", []),
        ("do not jump twice, just walk", ["walk"]),
        ("runs, not walks", ["run"]),
        ("a person jumps but does not land on the left foot", ["jump"]),
        ("kicks without using his hands", ["kick"]),
        ("does not sit and waves", ["wave"]),
        ("she stops clapping", []),
        ("he stops walking", ["stop"]),
        ("stand without moving", ["stand"]),
    ],
)
def test_a_negated_clause_claims_nothing(sentence: str, kinds: list[str]) -> None:
    assert [claim.kind for claim in request_of(sentence).claims] == kinds
    assert [claim.kind for claim in claims_of(sentence) if claim.kind not in kinds] == []


@pytest.mark.parametrize(
    "sentence",
    ["do not jump twice, just walk", "never turn around, walk straight", "don't turn 90 degrees",
     "a man with two dogs jumps", "a person jumps over two boxes", "a 180 pose",
     "turn 90 centimeters", "a person spins a basketball"],
)  # fmt: skip
def test_nothing_is_corrected_towards_what_is_not_asked(sentence: str) -> None:
    assert asked_exactly(sentence, True) == NO_CORRECTIONS
