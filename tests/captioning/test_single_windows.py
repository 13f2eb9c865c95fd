"""Windows with one action alone: each acted motion gives its own, and mixtures give none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from latentmotion.measure.facts import SingleAction
from latentmotion.measure.scene import describe
from latentmotion.training.captioning.single_actions import (
    LONGEST,
    SHORTEST,
    candidates,
    single_actions,
)
from latentmotion.training.captioning.strictness import strictly
from tests.support import acted

SWAPPED = {"left": "right", "right": "left"}
Make = Callable[[], np.ndarray]


def found_in(
    joints: np.ndarray, seed: int = 0, kinds: frozenset[str] | None = None
) -> list[SingleAction]:
    return single_actions(joints, np.random.default_rng(seed), kinds)


def framed(motion: np.ndarray) -> np.ndarray:
    """A motion between two stands of a second and a half."""
    return acted.in_sequence(acted.stand(1.5), motion, acted.stand(1.5))


SHOWN: list[tuple[str, Make, dict[str, object]]] = [
    ("kick", lambda: acted.kick("left"), {"side": "left", "count": 1, "direction": "forward"}),
    ("kick", lambda: acted.kick("right", 1, "side"), {"side": "right", "direction": "side"}),
    ("jump", acted.jump, {"side": "", "count": 1, "direction": ""}),
    ("jump", lambda: acted.jump(speed=1.0), {"direction": "forward"}),
    ("hop", lambda: acted.hop("right"), {"side": "right"}),
    ("knee", lambda: acted.knee_up("left"), {"side": "left"}),
    ("balance", lambda: acted.balance("right"), {"side": "right"}),
    ("raise", lambda: acted.raise_hand("right"), {"side": "right", "direction": "up"}),
    ("raise", lambda: acted.raise_hand("both"), {"side": "both"}),
    ("wave", lambda: acted.wave("left"), {"side": "left", "count": 1}),
    ("clap", lambda: acted.clap(4), {"side": "", "count": 4}),
    ("arm_circle", lambda: acted.arm_circle("right", 2), {"side": "right", "direction": "forward"}),
    ("squat", acted.squat, {"count": 1}),
    ("bow", acted.bow, {"count": 1}),
    ("pick_up", lambda: acted.pick_up("left"), {"side": "left"}),
    ("turn", lambda: acted.turn_in_place(-90), {"side": "right", "gait": ""}),
    ("turn", lambda: acted.walk(3, turn=100), {"side": "left", "gait": "walk"}),
    ("circle", lambda: acted.walk(8, 1.1, turn=400), {"side": "left", "gait": "walk"}),
    ("half_circle", lambda: acted.walk(5, 1.0, turn=-180), {"side": "right", "gait": "walk"}),
    ("walk", lambda: acted.walk(5, 0.5), {"direction": "forward", "pace": "slow"}),
    ("walk", lambda: acted.walk(5, 1.1), {"direction": "forward", "pace": "normal"}),
    ("walk", lambda: acted.walk(5, 1.8, 180), {"direction": "backward", "pace": "fast"}),
    ("jog", lambda: acted.run(5, 2.3), {"direction": "forward", "pace": "normal"}),
    ("march", lambda: acted.march(4), {"side": ""}),
    ("jog_in_place", lambda: acted.march(4, 1.5), {"side": ""}),
    ("sit_down", lambda: acted.lowered("sit"), {}),
    ("sit", lambda: acted.held("sit", 4), {}),
    ("sit_floor", lambda: acted.held("floor", 4), {}),
    ("lie_down", lambda: acted.lowered("lie"), {}),
    ("lie", lambda: acted.held("lie", 4), {}),
    ("kneel", lambda: acted.lowered("kneel"), {}),
    ("crouch", lambda: acted.lowered("crouch"), {}),
    ("crawl", lambda: acted.crawl(4), {}),
    ("stand_up", lambda: acted.lowered("sit")[::-1], {}),
    ("get_up", lambda: acted.lowered("lie")[::-1], {}),
    ("stand", lambda: acted.stand(4), {}),
    ("start_walking", lambda: acted.in_sequence(acted.stand(2), acted.walk(3)), {}),
    ("stop_walking", lambda: acted.in_sequence(acted.walk(3), acted.stand(2)), {}),
    ("arms_out", lambda: acted.hands(3, (0.5, 0.0, 0.0)), {"side": ""}),
    ("touch_head", lambda: acted.hands(3, (-0.05, 0.1, 0.1), ("left",)), {"side": "left"}),
    ("jack", lambda: acted.jack(1), {"count": 1}),
]
HELD = {
    "sit",
    "sit_floor",
    "lie",
    "crawl",
    "stand",
    "circle",
    "half_circle",
    "sit_down",
    "lie_down",
}
GAITS = {"walk", "jog", "march", "jog_in_place", "stand_up", "get_up", "kneel", "crouch"}


@pytest.mark.parametrize(
    ("kind", "make", "fields"), SHOWN, ids=[f"{kind}-{n}" for n, (kind, _, _) in enumerate(SHOWN)]
)
def test_a_motion_shows_its_action(kind: str, make: Make, fields: dict[str, object]) -> None:
    whole = kind in HELD | GAITS or kind.startswith(("start", "stop"))
    joints = make() if whole else framed(make())
    shown = [action for seed in range(3) for action in found_in(joints, seed, frozenset({kind}))]
    assert shown
    for action in shown:
        assert {name: getattr(action, name) for name in fields} == fields
        assert SHORTEST <= action.frames <= LONGEST and action.frames % 4 == 0
        assert action.start < action.act[1] and action.act[0] < action.end


@pytest.mark.parametrize("name", ["kick", "wave", "turn left", "raise a knee"])
def test_mirrored_windows_are_the_same(name: str) -> None:
    joints = framed(acted.MOTIONS[name]())
    one, other = found_in(joints), found_in(acted.mirrored(joints))
    assert one
    plain = [replace(action, degrees=round(action.degrees, 3)) for action in one]
    assert plain == [
        replace(
            action,
            side=SWAPPED.get(action.side, action.side),
            direction=SWAPPED.get(action.direction, action.direction),
            degrees=round(action.degrees, 3),
        )
        for action in other
    ]


@pytest.mark.parametrize("kind", ["kick", "squat", "clap"])
def test_only_the_kinds_that_are_asked_for(kind: str) -> None:
    joints = acted.in_sequence(
        acted.kick(), acted.stand(2), acted.squat(), acted.stand(2), acted.clap()
    )
    assert {action.kind for action in found_in(joints, 0, frozenset({kind}))} == {kind}


@pytest.mark.parametrize(
    ("joints", "never"),
    [
        (acted.in_sequence(acted.kick("left"), acted.kick("right")), ("knee", "jump")),
        (acted.raise_hand("both"), ("wave", "punch")),
        (acted.walk(4), ("turn", "march", "circle", "run")),
        (acted.jump(2), ("hop", "walk", "kick", "squat")),
        (acted.squat(2), ("sit", "sit_down", "kneel", "jump")),
        (acted.punch("left", 2), ("wave", "raise")),
    ],
    ids=["kicks", "both hands", "walk", "jumps", "squats", "punches"],
)
def test_other_actions_are_not_shown(joints: np.ndarray, never: tuple[str, ...]) -> None:
    assert not {action.kind for action in found_in(framed(joints))} & set(never)


def test_windows_count_what_they_hold() -> None:
    kicks = [one for one in found_in(framed(acted.kick("left", 3))) if one.kind == "kick"]
    assert {one.count for one in kicks} == {1, 2, 3}


@pytest.mark.parametrize("frames", [0, 3, SHORTEST - 1])
def test_a_short_motion_has_no_window(frames: int) -> None:
    assert found_in(acted.stand(2)[:frames]) == []


@pytest.mark.parametrize(
    ("action", "name", "kept"),
    [
        (SingleAction("kick", 0, 50, "left"), "kick", True),
        (SingleAction("kick", 0, 50, "right"), "kick", False),
        (SingleAction("kick", 0, 50, "left", count=2), "kick", False),
        (SingleAction("jump", 0, 50), "kick", False),
        (SingleAction("wave", 0, 80, "right"), "wave", True),
        (SingleAction("wave", 0, 80, "both"), "wave", False),
        (SingleAction("raise", 0, 80, "right"), "wave", False),
        (SingleAction("turn", 0, 60, "left"), "turn left", True),
        (SingleAction("turn", 0, 60, "right"), "turn left", False),
        (SingleAction("walk", 0, 80, direction="forward"), "walk", True),
        (SingleAction("walk", 0, 80, direction="backward"), "walk", False),
        (SingleAction("jog", 0, 80, direction="forward"), "walk", False),
        (SingleAction("walk", 0, 80, direction="forward"), "walk a curve", False),
        (SingleAction("steps", 0, 58, count=3), "three steps", True),
        (SingleAction("steps", 0, 58, count=2), "three steps", False),
        (SingleAction("squat", 0, 100, count=2), "squat", True),
        (SingleAction("sit_down", 0, 90), "lie down", False),
        (SingleAction("sit_down", 0, 90), "sit down", True),
        (SingleAction("balance", 0, 60, "left"), "balance", True),
        (SingleAction("balance", 0, 60, "right"), "balance", False),
        (SingleAction("arm_circle", 0, 61, "right", "backward", 2), "circle an arm", True),
        (SingleAction("arm_circle", 0, 61, "left", "backward", 2), "circle an arm", False),
        (SingleAction("climb", 0, 68, direction="up"), "climb", True),
        (SingleAction("climb", 0, 68, direction="down"), "climb", False),
        (SingleAction("speed_up", 0, 80), "walk", True),
        (SingleAction("stand", 0, 40), "stand", True),
        (SingleAction("stand", 0, 40), "walk", False),
        (SingleAction("clap", 0, 50, count=3), "clap", True),
        (SingleAction("clap", 0, 50, count=2), "clap", False),
    ],
)
def test_a_window_is_kept_if_it_shows_the_action_alone(
    action: SingleAction, name: str, kept: bool
) -> None:
    assert (strictly(action, acted.scene(name)) is not None) is kept


@pytest.mark.parametrize(
    ("speed", "pace"), [(0.6, "slow"), (0.82, ""), (1.1, "normal"), (1.7, "fast")]
)
def test_paces_between_two_bounds_have_no_name(speed: float, pace: str) -> None:
    scene = describe(acted.walk(4, speed))
    action = strictly(SingleAction("walk", 0, 80, direction="forward"), scene)
    assert action is not None and action.pace == pace


def test_a_faster_and_a_slower_gait() -> None:
    speed = np.linspace(0.5, 1.5, 100)
    faster = acted.Body(frames=100, ahead=speed).joints()
    slower = acted.Body(frames=100, ahead=speed[::-1]).joints()
    for joints, kind, other in (
        (faster, "speed_up", "slow_down"),
        (slower, "slow_down", "speed_up"),
    ):
        either = frozenset({kind, other})
        kinds = {action.kind for seed in range(3) for action in found_in(joints, seed, either)}
        assert kind in kinds and other not in kinds


def test_a_weaving_walk() -> None:
    time = np.arange(160) / acted.FPS
    joints = acted.Body(frames=160, ahead=1.0, heading=45 * np.sin(1.6 * time)).joints()
    weave = frozenset({"weave"})
    found = [one for seed in range(3) for one in found_in(joints, seed, weave)]
    assert found and {one.gait for one in found} == {"walk"}
    assert not found_in(acted.walk(8), 0, weave)


def test_candidates_are_inside_the_motion() -> None:
    for name in ("walk, then wave", "kick to the side", "walk a circle", "sit down"):
        for action in candidates(acted.scene(name), np.random.default_rng(0)):
            assert 0 <= action.start < action.end <= acted.scene(name).frames, action
