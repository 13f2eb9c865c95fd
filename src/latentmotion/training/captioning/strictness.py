"""Checks that a window shows a single action and nothing else that is worth reporting."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from latentmotion.language.kinds import limits
from latentmotion.measure.facts import BOTH, LEFT, RIGHT, SIDES, Event, SingleAction
from latentmotion.measure.scene import Measured, highest_hand, in_place, meters, reportable_kinds
from latentmotion.measure.signals import peaks
from latentmotion.measure.whole_body import stillness
from latentmotion.training.captioning.strict_locomotion import CALM, CHECKS, checks

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
