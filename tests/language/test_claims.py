"""Claims read from sentences: action, side, direction, count, degrees, pace, order."""

from __future__ import annotations

import pytest

from latentmotion.language.claims import SLIGHT, Claim
from latentmotion.language.reading import claims_of


def claim(sentence: str) -> Claim:
    (one,) = claims_of(sentence)
    return one


@pytest.mark.parametrize(
    ("sentence", "kind"),
    [
        ("a man strolls through the park", "walk"),
        ("she tiptoes away", "walk"),
        ("he sprints", "run"),
        ("someone dashes off", "run"),
        ("a person trots along", "jog"),
        ("a person takes a seat", "sit"),
        ("he is seated", "sit"),
        ("she gets up again", "stand_up"),
        ("he rises to his feet", "stand_up"),
        ("a man lies on the bed", "lie_down"),
        ("a person knelt", "kneel_down"),
        ("she bends her knees", "squat"),
        ("he ducks down", "crouch"),
        ("a person picks something up", "pick_up"),
        ("she touches the floor", "pick_up"),
        ("the man leans forward", "bow"),
        ("a person leaps", "jump"),
        ("he throws an uppercut", "punch"),
        ("the crowd applauds", "clap"),
        ("a person balances on one leg", "balance"),
        ("he stands on his left foot", "balance"),
        ("someone pivots", "turn"),
        ("a person does a u-turn", "turn"),
        ("he veers", "turn"),
        ("a person reaches up with a hand", "raise"),
        ("he holds his arms up", "raise"),
        ("a person comes to a standstill", "stop"),
        ("she remains motionless", "stand"),
        ("a person shuffles", "move"),
        ("he retreats", "move"),
        ("a person backs up", "move"),
        ("a man swings his arms in circles", "arm_circle"),
        ("a person lifts a box", "lift"),
        ("a person raises their right leg", "knee"),
        ("he turns the handle", "twist"),
        ("she rotates her hips", "twist"),
        ("he turns his head to the left", "twist"),
    ],
)
def test_verbs_and_their_kinds(sentence: str, kind: str) -> None:
    assert claim(sentence).kind == kind


@pytest.mark.parametrize(
    "sentence",
    [
        "a person dances happily",
        "someone does push-ups",
        "he does sit ups",
        "a person runs their hands over the table",
        "a man walks... no, a walkman",
        "a basketball player makes a jump shot",
        "jump rope",
        "",
        "faints and drops to the ground",
        "collapses down onto the floor",
        "rolls on the ground",
    ],
)
def test_words_that_only_look_like_a_claim(sentence: str) -> None:
    assert {one.kind for one in claims_of(sentence)} <= {"walk"}


@pytest.mark.parametrize(
    ("sentence", "side"),
    [
        ("a person kicks with the left leg", "left"),
        ("a person kicks with his right foot", "right"),
        ("a left hook, then he punches", ""),
        ("he throws a right punch", "right"),
        ("she waves with both hands", "both"),
        ("he raises his arms", "both"),
        ("he raises an arm", ""),
        ("a person hops on the right foot", "right"),
        ("turn to the left", "left"),
        ("turns clockwise", "right"),
        ("turns counterclockwise", "left"),
        ("turns counter-clockwise", "left"),
        ("spins anti-clockwise", "left"),
        ("walks in a clockwise circle", "right"),
        ("stands on his right leg", "right"),
        ("balances on the left foot", "left"),
        ("swings the left arm in circles", "left"),
        ("rotates both arms in circles", "both"),
    ],
)
def test_sides(sentence: str, side: str) -> None:
    assert claims_of(sentence)[-1].side == side


@pytest.mark.parametrize(
    ("sentence", "direction"),
    [
        ("walks forward", "forward"),
        ("walks straight ahead", "forward"),
        ("walks backwards", "backward"),
        ("walks in reverse", "backward"),
        ("backs away", "backward"),
        ("a person backs up slowly", "backward"),
        ("steps to the left", "left"),
        ("walks rightwards", "right"),
        ("walks sideways", "side"),
        ("sidesteps to the right", "right"),
        ("moves laterally", "side"),
        ("jogs in place", "place"),
        ("jumps on the spot", "place"),
        ("jumps forward", "forward"),
        ("kicks back", "backward"),
        ("walks to the left of the screen", ""),
        ("walks", ""),
    ],
)
def test_directions(sentence: str, direction: str) -> None:
    assert claim(sentence).direction == direction


@pytest.mark.parametrize(
    ("sentence", "count"),
    [
        ("jumps twice", 2),
        ("jumps three times", 3),
        ("jumps 4 times", 4),
        ("kicks once", 1),
        ("does two squats", 2),
        ("makes five small jumps", 5),
        ("kicks one leg", 0),
        ("jumps over one box", 0),
        ("jumps for 30 seconds", 0),
        ("jumps several times", 0),
        ("punches thrice", 3),
    ],
)
def test_counts(sentence: str, count: int) -> None:
    assert claim(sentence).count == count


@pytest.mark.parametrize(
    ("sentence", "degrees"),
    [
        ("turns left by 90 degrees", 90),
        ("turns 45° to the right", 45),
        ("makes a quarter turn", 90),
        ("does an about-face", 180),
        ("makes a half turn", 180),
        ("makes a full turn", 360),
        ("turns halfway, half a circle", 180),
        ("spins 360", 360),
        ("turns slightly left", SLIGHT),
        ("turns a little", SLIGHT),
        ("turns", 0),
    ],
)
def test_degrees(sentence: str, degrees: float) -> None:
    assert claims_of(sentence)[-1].degrees == degrees


@pytest.mark.parametrize(
    ("sentence", "pace"),
    [
        ("walks slowly", "slow"),
        ("slowly walks", "slow"),
        ("walks cautiously", "slow"),
        ("walks briskly forward", "fast"),
        ("quickly runs away", "fast"),
        ("walks at speed", "fast"),
        ("walks", ""),
    ],
)
def test_paces(sentence: str, pace: str) -> None:
    assert claim(sentence).pace == pace


@pytest.mark.parametrize(
    "join",
    [", then ", " and then ", " then ", "; ", ". ", " before she ", ", after which she ", " next "],
)
def test_words_that_tell_an_order(join: str) -> None:
    walk, kick = claims_of(f"a person walks{join}kicks")
    assert (walk.kind, walk.then, kick.kind, kick.then) == ("walk", False, "kick", True)


@pytest.mark.parametrize("join", [" and ", " while she ", ", "])
def test_words_that_tell_no_order(join: str) -> None:
    assert not any(one.then for one in claims_of(f"a person walks{join}kicks"))


@pytest.mark.parametrize(
    "sentence",
    [
        "walks and then throws a left punch",
        "walks and slowly sits down",
        "walks forward and two hops follow",
        "walks then backwards jumps",
    ],
)
def test_words_before_a_verb_are_not_of_the_verb_before(sentence: str) -> None:
    walk = claims_of(sentence)[0]
    assert (walk.kind, walk.direction in ("", "forward")) == ("walk", True)
    assert (walk.pace, walk.count) == ("", 0)


@pytest.mark.parametrize(
    ("sentence", "kinds"),
    [
        ("a person runs and jumps", ["run", "jump"]),
        ("a person runs and then stops", ["run", "stop"]),
        ("he runs his hands over the wall, then walks", ["walk"]),
        ("a person is running, then kicks", ["run", "kick"]),
    ],
)
def test_running_is_told_from_running_a_hand_over_things(sentence: str, kinds: list[str]) -> None:
    assert [one.kind for one in claims_of(sentence)] == kinds


def test_words_belong_to_their_own_verb() -> None:
    walk, kick, turn = claims_of(
        "he walks backwards slowly, quickly kicks twice with his left leg, then turns right"
    )
    assert walk == Claim("walk", direction="backward", pace="slow")
    assert kick == Claim("kick", side="left", count=2, pace="fast")
    assert turn == Claim("turn", side="right", then=True)


def test_what_belongs_to_a_gait_is_no_claim_of_its_own() -> None:
    assert claims_of("jogs in place") == (Claim("jog", direction="place"),)
    assert [one.kind for one in claims_of("circles his arms in circles")] == ["arm_circle"]
