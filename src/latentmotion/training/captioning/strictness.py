"""Checks that a window shows a single action and nothing else that is worth reporting.

Of locomotion it shows one kind alone: straight, turned, started or stopped.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from latentmotion.language.claims import kinds, limits
from latentmotion.measure.facts import BOTH, FPS, LEFT, RIGHT, SIDES, Event, SingleAction
from latentmotion.measure.scene import Measured, highest_hand, in_place, meters, reportable_kinds
from latentmotion.measure.signals import peaks
from latentmotion.measure.whole_body import stillness, stooped
from latentmotion.plugins import entries

Check = Callable[[SingleAction, Measured], SingleAction | None]
"""Returns an action as a window shows it; None where the window does not show it."""

CALM = frozenset(kinds("calm"))
"""Kinds that are reported where nothing else is."""

_GAITS = frozenset(kinds("gait"))

# Standing, walking or running, by kind of move.
_CLASS = {"stand": "stand", "walk": "walk", "jog": "run", "run": "run"}

# Classes of the moves of starts, stops and changes of gait.
_STAGES = {
    "start_walking": ["stand", "walk"], "start_running": ["stand", "run"],
    "stop_walking": ["walk", "stand"], "stop_running": ["run", "stand"],
    "walk_to_run": ["walk", "run"], "run_to_walk": ["run", "walk"],
}  # fmt: skip

# Speeds, m/s: below the first is slow, between the next two normal, above the last fast.
_SPEEDS = {"walk": (0.8, 0.85, 1.35, 1.4), "jog": (1.9, 2.0, 2.6, 2.7), "run": (0.0, 2.7, 3.3, 3.6)}

CHECKS: dict[str, Check] = {}
"""Checks by kind of action; `strictness` adds those of acts and postures."""


checks = entries(CHECKS)
"""Registers the check of some kinds of actions."""


def _is_upright(scene: Measured) -> bool:
    standing = sum(posture.frames for posture in scene.postures if posture.kind == "stand")
    runs = any(move.kind in ("jog", "run") for move in scene.moves)
    height, lean = (0.72, 40) if runs else (0.8, 25)
    low = (scene.signals.joints[:, 0, 1] < height) | (scene.signals.lean > lean)
    upright = standing > 0.95 * scene.frames and float(low.mean()) < (0.3 if runs else 0.15)
    return upright and not _spreads_arms(scene)


def _spreads_arms(scene: Measured) -> bool:
    """Whether both arms are held out for half a second, as actors do before a take."""
    outward = [
        (scene.signals.of(f"{side}_wrist") - scene.signals.of(f"{side}_shoulder"))[:, 0] * sign
        for side, sign in ((LEFT, 1), (RIGHT, -1))
    ]
    return int((np.minimum(*outward) > 0.28).sum()) >= 10


def _is_straight(scene: Measured, turned: float) -> bool:
    """Whether the path is straight and the heading changes by at most so many degrees."""
    points = scene.signals.joints[:, 0, ::2]
    net = float(np.linalg.norm(points[-1] - points[0]))
    heading = np.degrees(scene.signals.heading)
    return (
        abs(scene.path.turned) <= turned
        and np.ptp(heading) <= turned + 20
        and net >= 0.9 * scene.path.length
    )


@checks("walk", "jog", "run")
def _gait(action: SingleAction, scene: Measured) -> SingleAction | None:
    kinds = {"walk"} if action.kind == "walk" else {"jog", "run"}
    if reportable_kinds(scene) - CALM - kinds or not _is_upright(scene):
        return None
    moves = [move for move in scene.moves if move.kind != "stand"]
    if {move.direction for move in moves} != {action.direction}:
        return None
    if not {move.kind for move in moves} <= kinds:
        return None
    moving = sum(move.frames for move in moves) / scene.frames
    if moving < 0.9 or not _is_straight(scene, 18) or scene.path.length < 0.5:
        return None
    speed = float(scene.signals.speed.mean())
    kind = action.kind if action.kind == "walk" else "run" if speed > 2.6 else "jog"
    slow, least, most, fast = _SPEEDS[kind]
    pace = "normal" if least <= speed <= most else ""
    return replace(
        action, kind=kind, pace="slow" if speed < slow else "fast" if speed > fast else pace
    )


@checks("turn", "circle", "half_circle")
def _turn(action: SingleAction, scene: Measured) -> SingleAction | None:
    facts, net = scene, scene.path.turned
    turns, length, degrees = facts.turns, facts.path.length, abs(net)
    if reportable_kinds(scene) - CALM - _GAITS - {"turn"} or not turns:
        return None
    side = LEFT if net > 0 else RIGHT
    total = sum(turn.amount for turn in turns)
    if len(turns) > 1 and action.kind == "turn":
        return None
    if any(turn.side != side for turn in turns) or abs(total - degrees) > 20 + 0.1 * total:
        return None
    if side != action.side or not _is_upright(scene):
        return None
    kinds = {m.kind for m in facts.moves if m.kind in _GAITS and m.direction != "place"}
    if action.gait and (kinds != {action.gait} or length < 0.8):
        return None
    if not action.gait and length > 0.6:
        return None
    radius = length / max(np.radians(degrees), 0.1)
    if action.kind == "circle":
        shown = degrees >= 270 and length >= 2.2 and radius > 0.3
    elif action.kind == "half_circle":
        gradual = max(turn.frames for turn in turns) > 0.6 * facts.frames
        shown = 130 <= degrees <= 230 and length > 1.6 and radius > 0.4 and gradual
    else:
        shown = 18 <= degrees <= 430 and not (action.gait and degrees > 250)
    return replace(action, degrees=degrees) if shown else None


@checks("walk_then_turn", "turn_then_walk", "turn_and_return")
def _turn_with_gait(action: SingleAction, scene: Measured) -> SingleAction | None:
    """Checks a turn with 0.5 m and more of a straight path before it, after it or both."""
    turns, degrees = scene.turns, abs(scene.path.turned)
    other_kinds = reportable_kinds(scene) - CALM - _GAITS - {"turn"}
    if other_kinds or len(turns) != 1 or not _is_upright(scene):
        return None
    moves = [move for move in scene.moves if move.kind in _GAITS]
    if {m.kind for m in moves} != {action.gait} or any(m.direction == "place" for m in moves):
        return None
    if turns[0].side != action.side or abs(turns[0].amount - degrees) > 25 or degrees < 30:
        return None
    if action.kind == "turn_and_return" and not 140 <= degrees <= 225:
        return None
    first, last = action.act[0] - action.start, action.act[1] - action.start
    step = scene.signals.speed / FPS
    before, after = float(step[:first].sum()) > 0.5, float(step[last:].sum()) > 0.5
    if action.kind == "walk_then_turn":
        shown = before
    else:
        shown = after and (action.kind == "turn_then_walk" or before)
    return replace(action, degrees=degrees) if shown else None


@checks(*_STAGES)
def _change(action: SingleAction, scene: Measured) -> SingleAction | None:
    """Checks a start, a stop, or a change of gait: the moves are these two, straight."""
    other_kinds = reportable_kinds(scene) - CALM - _GAITS - {"turn"}
    if other_kinds or abs(scene.path.turned) > 40 or not _is_upright(scene):
        return None
    if any(turn.amount > 50 for turn in scene.turns):
        return None
    moves = [move for move in scene.moves if move.frames >= 8]
    kinds = [_CLASS.get(move.kind, "") for move in moves]
    stages = [kind for n, kind in enumerate(kinds) if n == 0 or kinds[n - 1] != kind]
    if stages != _STAGES[action.kind] or any(move.direction == "place" for move in moves):
        return None
    gaits = [move for move in moves if move.kind != "stand"]
    directions = {move.direction for move in gaits}
    fast = all(move.amount > (1.4 if move.kind in ("jog", "run") else 0.4) for move in gaits)
    if len(directions) != 1 or not fast or min(move.frames for move in gaits) < 10:
        return None
    return replace(action, direction=directions.pop())


@checks("speed_up", "slow_down")
def _paces(action: SingleAction, scene: Measured) -> SingleAction | None:
    moves = scene.moves
    if reportable_kinds(scene) - CALM - _GAITS:
        return None
    if not _is_upright(scene) or not _is_straight(scene, 40):
        return None
    if any(move.direction != "forward" for move in moves):
        return None
    gaits = {_CLASS[move.kind] for move in moves}
    if gaits == {"walk"} and float(scene.signals.speed.max()) > 1.9:
        return None
    return replace(action, gait=gaits.pop(), direction="forward") if len(gaits) == 1 else None


@checks("weave")
def _weaves(action: SingleAction, scene: Measured) -> SingleAction | None:
    if reportable_kinds(scene) - CALM - _GAITS - {"turn"} or not _is_upright(scene):
        return None
    left, ahead = scene.signals.velocity.T
    moving = scene.signals.speed > 0.3
    course = np.degrees(np.unwrap(scene.signals.heading + np.arctan2(left, ahead))[moving])
    if moving.mean() < 0.85 or scene.path.length < 1.6 or abs(scene.path.turned) > 80:
        return None
    swings = sum(len(peaks(c - c.min(), 0, 25)) for c in (course, -course))
    kinds = {move.kind for move in scene.moves if move.kind in _GAITS}
    return action if swings >= 2 and kinds == {action.gait} else None


@checks("steps")
def _steps(action: SingleAction, scene: Measured) -> SingleAction | None:
    if reportable_kinds(scene) - CALM - {"walk"} or scene.turns or not _is_upright(scene):
        return None
    distances = meters(scene)
    direction = max(distances, key=lambda name: distances[name])
    least = max(0.2 * action.count, 0.8 * sum(distances.values()))
    if scene.steps != action.count or distances[direction] < least:
        return None
    return replace(action, direction=direction) if abs(scene.path.turned) <= 30 else None


@checks("sneak")
def _sneaks(action: SingleAction, scene: Measured) -> SingleAction | None:
    low = stooped(scene.signals)
    postures = {posture.kind for posture in scene.postures}
    moves = [move for move in scene.moves if move.kind in _GAITS]
    if low.mean() <= 0.8 or not postures <= {"stand", "crouch", "bend"}:
        return None
    if {move.kind for move in moves} != {"walk"} or scene.path.length < 0.6:
        return None
    allowed = CALM | {"walk", "turn", "stay_crouch", "stay_bend", "bow", "squat"}
    if abs(scene.path.turned) > 60 or reportable_kinds(scene) - allowed:
        return None
    directions = {move.direction for move in moves}
    shown = len(directions) == 1 and directions <= {"forward", "backward"}
    return (
        replace(action, direction=directions.pop()) if shown and not _spreads_arms(scene) else None
    )


# Meters per second at which a punching fist leaves its shoulder; gestures are slower.
_PUNCH_SPEED = 2.1


@dataclass(frozen=True)
class Limits:
    """Other acts and movements that a window of a kind may show."""

    also: frozenset[str] = frozenset()
    """Kinds of acts that may be reported as well."""
    travel: float = 0.7
    """Most meters of the path of the pelvis."""
    turned: float = 45.0
    """Most degrees by which the heading changes."""


# Limits by kind of action.
_LIMITS = {
    kind: Limits(**{**row, "also": CALM | frozenset(row["also"].split())})
    for kind, row in tomllib.loads(
        Path(__file__).with_name("strictness.toml").read_text(encoding="utf-8")
    ).items()
}


def strictly(action: SingleAction, scene: Measured) -> SingleAction | None:
    """Returns the action as its window shows it, measured anew; None where it shows more, or less.

    Args:
        action: A candidate.
        scene: The measurements of its window alone.
    """
    limits, path = _LIMITS.get(action.kind), scene.path  # locomotion has none
    if limits and (path.length > limits.travel or abs(path.turned) > limits.turned):
        return None
    if limits and reportable_kinds(scene) - limits.also:
        return None
    return CHECKS[action.kind](action, scene)


def _of_side(action: SingleAction, events: list[Event]) -> bool:
    """Whether there are events and all are of the action's side."""
    sides = {event.side for event in events}
    return bool(events) and (action.side not in SIDES or sides == {action.side})


@checks("clap", "jack", "bow")
def _repeated(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of(action.kind)
    count = sum(event.count for event in events)
    return action if _of_side(action, events) and count == action.count else None


@checks("squat")
def _squats(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of("squat")
    planted = float(scene.signals.feet.max()) < 0.15
    shown = _of_side(action, events) and len(events) == action.count
    return action if planted and shown else None


@checks("jump", "hop")
def _jumps(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of("jump", "hop")
    if len(events) != action.count or any(e.amount < limits("rise")[e.kind] for e in events):
        return None
    if action.kind == "jump" and any(event.kind == "hop" for event in events):
        return None
    for event in events if action.kind == "hop" else ():
        # The other foot does not touch the floor around a hop.
        around = slice(max(event.start - 3, 0), event.end + 4)
        other = scene.signals.feet[around, 1 if action.side == LEFT else 0]
        if event.kind != "hop" or event.side != action.side or float(other.min()) <= 0.05:
            return None
    distances = meters(scene)
    direction = max(distances, key=lambda name: distances[name])
    far = distances[direction] > (0.3 if direction == "forward" else 0.2)
    if not far and scene.path.length >= 0.4:
        return None
    return replace(action, direction=direction if far else "")


@checks("kick")
def _kicks(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of("kick")
    if not _of_side(action, events) or len(events) != action.count or scene.all_of("hop"):
        return None
    directions = {event.direction for event in events}
    return replace(action, direction=directions.pop() if len(directions) == 1 else "")


@checks("punch")
def _punches(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of("punch")
    if len(events) != action.count or scene.all_of("wave"):
        return None
    sides = {event.side for event in events}
    right = sides == {action.side} or (action.side == BOTH and len(sides) == 2)
    quick = all(event.amount > _PUNCH_SPEED for event in events)
    return action if right and quick else None


@checks("wave")
def _waves(action: SingleAction, scene: Measured) -> SingleAction | None:
    others = [side for side in SIDES if action.side not in (side, BOTH)]
    others_down = all(highest_hand(scene, side) < 0.05 for side in others)
    calm = np.degrees(np.ptp(scene.signals.heading)) < 50
    right = {event.side for event in scene.all_of("wave")} == {action.side}
    return action if right and others_down and calm else None


@checks("raise")
def _raises(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of("raise")
    if scene.all_of("wave", "punch", "clap", "arm_circle") or len(events) != action.count:
        return None
    if any(event.side != action.side or event.amount < 0.12 for event in events):
        return None
    others = [side for side in SIDES if action.side not in (side, BOTH)]
    if any(highest_hand(scene, side) > -0.15 for side in others):
        return None
    directions = {event.direction for event in events}
    return replace(action, direction=directions.pop() if len(directions) == 1 else "")


@checks("knee")
def _knees(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of("knee")
    if scene.all_of("kick", "hop", "jump") or len(events) != action.count:
        return None
    sides = {event.side for event in events}
    shown = len(sides) == 2 if action.side == BOTH else sides == {action.side}
    return action if shown else None


@checks("march", "jog_in_place")
def _marches(action: SingleAction, scene: Measured) -> SingleAction | None:
    if not in_place(scene, 0.6):
        return None
    lifts = [len(peaks(foot, 0.05, 0.05)) for foot in scene.signals.feet.T]
    return action if min(lifts) >= 2 and sum(lifts) >= 4 else None


@checks("pick_up")
def _pick_ups(action: SingleAction, scene: Measured) -> SingleAction | None:
    events, postures = scene.all_of("pick_up"), scene.postures
    shown = len(events) == 1 and postures[0].kind == postures[-1].kind == "stand"
    return replace(action, side=events[0].side) if shown else None


@checks("balance", "arms_out", "hands_on_hips", "touch_head")
def _poses(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of(action.kind)
    held = sum(event.frames for event in events) > 0.4 * scene.frames
    if action.kind == "touch_head":
        held &= highest_hand(scene, RIGHT if action.side == LEFT else LEFT) <= -0.1
    if action.kind == "hands_on_hips":
        # Both hands are at the sides of the waist, elbows out, and not in front of the belly.
        at_hips = np.ones(scene.frames, bool)
        for side, sign in ((LEFT, 1), (RIGHT, -1)):
            wrist, elbow = scene.signals.of(f"{side}_wrist"), scene.signals.of(f"{side}_elbow")
            high = wrist[:, 1] - scene.signals.joints[:, 0, 1]
            at_hips &= (sign * wrist[:, 0] > 0.13) & (sign * (elbow - wrist)[:, 0] > 0.05)
            at_hips &= (wrist[:, 2] < 0.17) & (high > -0.05) & (high < 0.3)
        held &= float(at_hips.mean()) > 0.5
    return action if held and _of_side(action, events) else None


@checks("arm_circle")
def _arm_circles(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of("arm_circle")
    if {event.side for event in events} != {action.side}:
        return None
    count = sum(event.count for event in events)
    return replace(action, direction=events[0].direction, count=count)


# Sequences of postures that show an action; short postures that are not in them are left out.
_SEQUENCES = {
    "sit_down": ("stand sit",),
    "sit": ("sit",),
    "stand_up": ("sit stand",),
    "sit_floor": ("stand floor", "floor", "stand kneel floor"),
    "lie_down": ("stand lie", "stand floor lie", "stand kneel lie"),
    "get_up": (
        "lie stand", "floor stand", "lie kneel stand", "lie floor stand", "floor kneel stand",
    ),
    "kneel": ("stand kneel", "kneel"),
    "crouch": ("stand crouch", "crouch", "stand crouch stand"),
}  # fmt: skip


@checks(*_SEQUENCES)
def _postures(action: SingleAction, scene: Measured) -> SingleAction | None:
    seat = action.kind in ("sit_down", "sit", "stand_up")
    if seat and float(scene.signals.joints[:, 0, 1].min()) <= 0.35:  # lower than a low stool
        return None
    for stages in map(str.split, _SEQUENCES[action.kind]):
        long_enough = [
            posture.kind
            for posture in scene.postures
            if posture.kind in stages
            or posture.frames >= (30 if posture.kind in ("bend", "crouch") else 16)
        ]
        if stages == [
            kind for n, kind in enumerate(long_enough) if n == 0 or long_enough[n - 1] != kind
        ]:
            return action
    return None


@checks("lie")
def _lies(action: SingleAction, scene: Measured) -> SingleAction | None:
    alone = {posture.kind for posture in scene.postures} == {"lie"}
    return action if alone and scene.activity < 0.35 else None


@checks("crawl")
def _crawls(action: SingleAction, scene: Measured) -> SingleAction | None:
    held = sum(event.frames for event in scene.all_of("crawl"))
    return action if held > 0.8 * scene.frames else None


@checks("climb")
def _climbs(action: SingleAction, scene: Measured) -> SingleAction | None:
    events = scene.all_of("climb")
    return action if [event.direction for event in events] == [action.direction] else None


@checks("stand")
def _stands(action: SingleAction, scene: Measured) -> SingleAction | None:
    still = stillness(scene.signals).mean() >= 0.85
    standing = all(posture.kind == "stand" for posture in scene.postures)
    hands_down = all(highest_hand(scene, side) < -0.15 for side in SIDES)
    return action if still and standing and hands_down else None
