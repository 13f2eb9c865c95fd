"""What prompts ask for, in the words of users."""

from __future__ import annotations

import pytest

from latentmotion.language.claims import NO_CORRECTIONS, Claim, Corrections, Count
from latentmotion.language.reading import (
    asked_exactly,
    claims_of,
    counted_range,
    request_of,
    stays_on_floor,
    told_in_order,
    usual_range,
)


@pytest.mark.parametrize(
    ("prompt", "claim"),
    [
        ("do a one-eighty", Claim("turn", degrees=180)),
        ("he does a 360 to the left", Claim("turn", "left", degrees=360)),
        ("turn ninety degrees to your right", Claim("turn", "right", degrees=90)),
        ("a full circle on the spot to the left", Claim("turn", "left", degrees=360)),
        ("she turns around", Claim("turn", degrees=180)),
        ("turn and face the other way", Claim("turn", degrees=180)),
        ("a dancer spins clockwise", Claim("turn", "right", degrees=360)),
        ("face left", Claim("turn", "left")),
        ("strafe left", Claim("move", direction="left")),
        ("two punches with the right hand", Claim("punch", "right", count=2)),
        ("just one jab with the left.", Claim("punch", "left", count=1)),
        ("kick something with the left foot three times", Claim("kick", "left", count=3)),
        ("hop on one leg twice", Claim("hop", count=2)),
        ("three left knee raises", Claim("knee", "left", count=3)),
        ("put your right arm in the air", Claim("raise", "right")),
        ("hands up!", Claim("raise", "both")),
        ("from sitting to standing", Claim("stand_up")),
        ("four star jumps", Claim("jack", count=4)),
        ("sit on the floor", Claim("floor")),
        ("someone enters the room", Claim("walk")),
        ("go to the door", Claim("walk")),
        ("retreating without turning around", Claim("move", direction="backward")),
        ("take one step forward", Claim("move", direction="forward", count=1)),
    ],
)
def test_users_words(prompt: str, claim: Claim) -> None:
    assert request_of(prompt).claims == (claim,)


@pytest.mark.parametrize(
    ("prompt", "kinds"),
    [
        ("after kicking, the man walks away", "kick left, walk"),
        ("before jumping, she walks", "walk, jump"),
        ("a person sits down after walking a few steps", "walk, sit"),
        ("kick with the left leg, then with the right leg", "kick left, kick right"),
        ("step right, then left", "move right, move left"),
        ("first the right arm goes up, then the left arm", "raise right, raise left"),
    ],
)
def test_orders_and_verbs_that_are_left_out(prompt: str, kinds: str) -> None:
    asked = request_of(prompt)
    found = [" ".join(filter(None, (c.kind, c.side or c.direction))) for c in asked.claims]
    assert [one.split()[0] for one in found] == [one.split()[0] for one in kinds.split(", ")]
    assert all(one in kinds for one in found) and asked.in_turn and asked.claims[1].then


@pytest.mark.parametrize(
    ("prompt", "act", "side", "times"),
    [
        ("a person jumps three times", "jump", "", 3),
        ("two big hops forward", "jump", "", 2),
        ("hop twice on one leg", "hop", "", 2),
        ("three kicks with the left foot", "kick", "left", 3),
        ("walk exactly four steps", "step", "", 4),
        ("raise both arms two times", "raise", "both", 2),
        ("squat down and stand up twice", "squat", "", 2),
        ("clap three times", "clap", "", 3),
        ("walk forward, then bow twice", "bow", "", 2),
    ],
)
def test_a_count_is_asked(prompt: str, act: str, side: str, times: int) -> None:
    assert asked_exactly(prompt, True) == Corrections(count=Count(act, side, times))
    assert asked_exactly(prompt, False) == NO_CORRECTIONS


@pytest.mark.parametrize(
    "prompt",
    ["jump", "a few jumps", "several kicks", "jump two or three times", "kick at least twice",
     "two people kick", "wave twice", "jump twice, then kick twice",
     "walk forward, then take two steps back", "takes two steps and kicks",
     "kick twice, then kick with the left leg",
     "jump about three times", "kick 2-3 times", ""],
)  # fmt: skip
def test_no_exact_count_is_asked(prompt: str) -> None:
    assert asked_exactly(prompt, True) == NO_CORRECTIONS


def test_what_happens_meanwhile_has_no_order() -> None:
    assert not request_of("a person waves while walking").in_turn


def test_nothing_measurable_is_nothing_asked() -> None:
    assert request_of("a person juggles").claims == ()


def test_captions_are_read_as_before() -> None:
    assert claims_of("do a one-eighty") == () and claims_of("four star jumps")[0].kind == "jump"


@pytest.mark.parametrize(
    ("prompt", "expected"),
    [
        ("a person salutes", (1.6, 4.0)),
        ("he shakes his head", (1.6, 4.0)),
        ("a man runs", (2.5, float("inf"))),
        ("jump", (2.0, 4.0)),
        ("jump three times", None),
        ("walk forward, then sit down", None),
        ("walks and salutes", (2.5, float("inf"))),
        ("stand still", None),
    ],
)
def test_a_single_act_has_a_usual_range(prompt: str, expected: tuple[float, float] | None) -> None:
    assert usual_range(prompt) == expected


@pytest.mark.parametrize(
    ("prompt", "seconds"),
    [("kick three times", 3.6), ("raise both arms twice", 3.2), ("jump three times", None),
     ("kick", None), ("kick twice, then bow", None), ("", None)],
)  # fmt: skip
def test_repetitions_last_as_long_as_so_many_do(prompt: str, seconds: float | None) -> None:
    limits = counted_range(prompt)
    assert (limits and sum(limits) / 2) == (seconds and pytest.approx(seconds))


@pytest.mark.parametrize(
    ("prompt", "told"),
    [
        ("before sitting down he waves", "he waves, then sits down"),
        ("before the man sits down, he waves", "he waves, then the man sits down"),
        ("she kicks after a bow", "a bow, then she kicks"),
        ("walks after standing up, then sits", "stands up, then walks, then sits"),
        ("raises the left arm, then the right", "raises the left arm, then raises the right arm"),
        ("waves with the left hand, then with the right one",
         "waves with the left hand, then waves with the right hand"),
        ("he kicks once with each leg",
         "he kicks once with the left leg, then kicks once with the right leg"),
        ("stand on the left leg, then on the right",
         "stand on the left leg, then stand on the right leg"),
        ("looks left, then right", "looks left, then looks right"),
        ("a man walks backwards slowly, then quickly",
         "a man walks backwards slowly, then walks backwards quickly"),
        *((same, same) for same in (
            "he runs after the ball", "she stands before the king", "one after another they jump",
            "wave after wave", "holds a sword in each hand", "left, then on", "after", "",
        )),
    ],
)  # fmt: skip
def test_acts_are_told_in_the_order_of_time(prompt: str, told: str) -> None:
    assert told_in_order(prompt) == told and told_in_order(told) == told


@pytest.mark.parametrize(
    ("prompt", "stays"),
    [
        ("walk up, turn around and walk back", True),
        ("a person kicks twice", True),
        ("someone walks up the stairs", False),
        ("she climbs", False),
        ("a man jumps onto a box", False),
        ("rides a horse", False),
    ],
)
def test_who_stays_on_the_floor(prompt: str, stays: bool) -> None:
    assert stays_on_floor(prompt) is stays
