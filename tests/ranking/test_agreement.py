"""Verdicts: what a motion does agrees with a sentence, contradicts it, or says nothing of it."""

from __future__ import annotations

import pytest

from latentmotion.language.claims import Claim
from latentmotion.language.reading import claims_of
from latentmotion.measure.facts import Description, Event, FloorPath
from latentmotion.measure.scene import describe
from latentmotion.ranking.agreement import check, events_for, frames_for
from tests.support import acted

# Verdicts by motion and sentence, after "a person".
VERDICTS = {
    "stand": {
        "agrees": ["stands still", "stays motionless", "does not move"],
        "contradicts": [
            "walks",
            "runs forward",
            "jumps",
            "kicks with the left leg",
            "sits down",
            "lies on the floor",
            "kneels",
            "turns around",
            "turns left by 90 degrees",
            "does a squat",
        ],
        "silent": ["dances", "waves", "raises a hand", "punches", "claps", "stops", "turns a knob"],
    },
    "walk": {
        "agrees": [
            "walks",
            "walks forward",
            "strolls straight ahead",
            "moves",
            "walks fast",
            "steps",
        ],
        "contradicts": [
            "walks backward",
            "walks in place",
            "stands still",
            "walks in a circle",
            "jumps once",
            "walks and turns left",
            "sidesteps to the left, then jumps",
        ],
        "silent": ["waves", "stops"],
    },
    "walk slowly": {
        "agrees": ["walks slowly", "walks"],
        "contradicts": ["walks quickly", "runs", "jogs"],
    },
    "walk fast": {
        "agrees": ["walks briskly", "walks"],
        "contradicts": ["walks slowly"],
        "silent": ["runs", "jogs"],
    },
    "walk backward": {
        "agrees": ["walks backwards", "backs up", "retreats"],
        "contradicts": ["walks forward"],
    },
    "walk to the left": {
        "agrees": ["walks to the left", "sidesteps to the left", "walks sideways"],
        "contradicts": ["walks to the right", "walks forward"],
    },
    "walk a curve": {
        "agrees": ["walks and turns left", "turns left by 90 degrees", "makes a quarter turn"],
        "contradicts": [
            "turns right",
            "turns left by 180 degrees",
            "turns slightly to the right",
            "spins 360 degrees",
        ],
        "silent": ["turns his head to the right"],
    },
    "walk a circle": {
        "agrees": ["walks in a circle", "walks in a clockwise circle", "turns right"],
        "contradicts": ["walks in a circle to the left", "walks counterclockwise in a circle"],
    },
    "jog": {"agrees": ["jogs", "runs", "jogs slowly"], "silent": ["walks"]},
    "run": {"agrees": ["runs", "jogs", "runs fast"], "contradicts": ["walks", "walks slowly"]},
    "march": {
        "agrees": ["walks", "steps in place"],
        "contradicts": ["jumps", "turns left", "walks in a circle"],
    },
    "kick": {
        "agrees": ["kicks", "kicks with the left leg", "kicks once"],
        "contradicts": ["kicks with the right foot", "kicks twice", "jumps"],
        "silent": ["punches"],
    },
    "kick to the side": {
        "agrees": ["kicks twice with the right leg"],
        "contradicts": ["kicks twice with the left leg", "kicks three times"],
    },
    "hop twice": {
        "agrees": ["hops twice", "hops on the right foot", "jumps twice"],
        "contradicts": ["hops on the left leg", "hops three times"],
    },
    "jump forward": {
        "agrees": ["jumps forward", "leaps"],
        "contradicts": ["jumps backward", "jumps three times"],
    },
    "jump": {"agrees": ["jumps", "hops once"], "silent": ["jumps forward"]},
    "raise a hand": {
        "agrees": ["raises the left hand", "waves with the left hand", "raises an arm"],
        "contradicts": ["raises the right arm"],
        "silent": ["raises both hands", "lifts a box"],
    },
    "raise both hands": {"agrees": ["raises both arms", "raises his left hand"]},
    "wave": {
        "agrees": ["waves with the right hand", "raises a hand"],
        "contradicts": ["waves with the left hand"],
    },
    "punch": {
        "agrees": ["punches with the left fist", "throws two punches", "punches with both hands"],
        "contradicts": ["punches with the right fist"],
    },
    "balance": {
        "agrees": ["stands on the left leg", "balances on one foot"],
        "contradicts": ["stands on the right leg"],
    },
    "raise a knee": {
        "agrees": ["raises the right knee", "lifts a leg"],
        "contradicts": ["raises the left knee", "raises the knee three times"],
    },
    "squat": {
        "agrees": ["does two squats", "crouches", "squats"],
        "contradicts": ["does three squats", "sits down"],
    },
    "bow": {"agrees": ["bows", "leans forward", "picks something up"]},
    "pick up": {
        "agrees": ["picks something up with the right hand", "bends down", "bows"],
        "contradicts": ["picks it up with the left hand"],
    },
    "sit down": {
        "agrees": ["sits down", "takes a seat"],
        "contradicts": ["lies down", "walks"],
        "silent": ["stands up"],
    },
    "lie down": {"agrees": ["lies down", "lies on the floor"], "contradicts": ["kneels"]},
    "kneel down": {"agrees": ["kneels", "kneels down"], "contradicts": ["lies down", "jumps"]},
    "walk and stop": {"agrees": ["walks and stops", "walks, then stands still"]},
    "walk, then wave": {
        "agrees": ["walks, then waves with the left hand", "walks and waves"],
        "contradicts": ["waves with the left hand, then walks", "waves with the right hand"],
    },
    "wave, then walk": {
        "agrees": ["waves, then walks forward"],
        "contradicts": ["walks forward, then waves"],
    },
}

ROWS = [
    (motion, sentence, verdict)
    for motion, verdicts in VERDICTS.items()
    for verdict, told in verdicts.items()
    for sentence in told
]


@pytest.mark.parametrize(("motion", "sentence", "verdict"), ROWS)
def test_verdicts(motion: str, sentence: str, verdict: str) -> None:
    found = check(f"a person {sentence}", acted.scene(motion))
    assert found.verdict == verdict, found.reasons


def test_the_worst_claim_decides() -> None:
    found = check("a person walks forward, waves and jumps", acted.scene("walk"))
    assert found.verdicts == ("agrees", "silent", "contradicts")
    assert found.verdict == "contradicts"
    assert len(found.claims) == len(found.reasons) == 3
    assert all(
        text.startswith(one.kind) for text, one in zip(found.reasons, found.claims, strict=True)
    )


def test_reasons_name_what_was_found() -> None:
    found = acted.scene("kick")
    assert check("kicks with the right leg", found).reasons == ("kick: found left, expected right",)
    assert check("kicks twice", found).reasons == ("kick: found 1, told 2",)
    assert (
        "earlier" in check("a person waves, then walks", acted.scene("walk, then wave")).reasons[1]
    )


def test_claims_may_be_given_instead_of_a_sentence() -> None:
    claims = (Claim("kick", "left"),)
    assert check(claims, acted.scene("kick")) == check(
        "kicks with the left leg", acted.scene("kick")
    )


def test_a_sentence_without_claims_is_silent() -> None:
    found = check("a person dances to music", acted.scene("walk"))
    assert (found.claims, found.verdict) == ((), "silent")


@pytest.mark.parametrize(
    ("told", "verdict"),
    [(3, "agrees"), (4, "silent"), (2, "contradicts"), (1, "contradicts")],
)
def test_counts_up_to_three_are_exact(told: int, verdict: str) -> None:
    words = {1: "once", 2: "twice", 3: "three times", 4: "four times"}
    assert check(f"jumps {words[told]}", describe(acted.jump(3))).verdict == verdict


@pytest.mark.parametrize(
    ("told", "verdict"),
    [("four", "silent"), ("five", "agrees"), ("six", "silent"), ("eight", "contradicts")],
)
def test_large_counts_may_be_off_by_one(told: str, verdict: str) -> None:
    assert check(f"jumps {told} times", describe(acted.jump(5))).verdict == verdict


def test_repeated_kinds_share_their_count() -> None:
    found = describe(acted.in_sequence(acted.kick("left"), acted.kick("left")))
    assert check("kicks once, then kicks once", found).verdict == "silent"
    assert check("kicks once", found).verdict == "contradicts"


@pytest.mark.parametrize(
    ("degrees", "verdict"),
    [(40, "contradicts"), (60, "agrees"), (90, "agrees"), (140, "agrees"), (190, "contradicts")],
)
def test_degrees_have_a_tolerance(degrees: float, verdict: str) -> None:
    found = describe(acted.turn_in_place(degrees))
    assert check("turns left by 90 degrees", found).verdict == verdict


@pytest.mark.parametrize(
    ("degrees", "verdict"),
    [(-60, "contradicts"), (10, "silent"), (20, "agrees"), (60, "agrees")],
)
def test_slight_turns(degrees: float, verdict: str) -> None:
    found = describe(acted.turn_in_place(degrees, 1))
    assert check("turns slightly to the left", found).verdict == verdict


def test_a_twist_of_the_trunk_leaves_a_turn_open() -> None:
    body = acted.Body(frames=60, twist=45 * acted.bump(60, 5, 30, 55))
    found = describe(body.joints())
    assert check("a person turns left", found).verdict == "silent"
    assert check("a person turns right", found).verdict == "contradicts"


def test_a_jump_while_running_may_be_missed() -> None:
    assert check("a person runs and jumps", acted.scene("run")).verdicts[1] == "silent"
    assert check("a person walks and jumps", acted.scene("walk")).verdicts[1] == "contradicts"


def test_events_that_a_claim_may_mean() -> None:
    found = acted.scene("sit down")
    assert [event.kind for event in events_for("sit", found)] == ["sit_down", "sit"]
    assert events_for("kick", found) == ()
    (sit,) = claims_of("sits down")
    start, end = frames_for(sit, found) or (0, 0)
    assert start < 20 and end == found.frames


def test_the_frames_of_a_gait_are_those_of_its_direction() -> None:
    moves = (
        Event("walk", 0, 40, direction="forward", amount=1.0),
        Event("stand", 40, 60),
        Event("walk", 60, 100, direction="backward", amount=1.0),
    )
    stands = (Event("stand", 0, 100),)
    path = FloorPath(4, 0, 0, 0, 0, 0, False)
    found = Description(100, path, moves, (), stands, (), 8)
    assert frames_for(Claim("walk", direction="backward"), found) == (60, 100)
    assert frames_for(Claim("walk"), found) == (0, 100)
    assert frames_for(Claim("turn"), found) is None
    there_and_back = "a person walks forward, then walks backward"
    assert check(there_and_back, found).verdict == "agrees"
    back_and_there = "a person walks backward, then walks forward"
    assert check(back_and_there, found).verdict == "contradicts"
