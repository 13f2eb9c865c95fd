"""Whether hands and feet do in a window what an action says, as often and on its side alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from latentmotion.describe.facts import BOTH, LEFT, RIGHT, Event
from latentmotion.describe.scene import Scene, highest_hand, in_place, meters
from latentmotion.describe.signals import peaks
from latentmotion.describe.single import SingleAction

Check = Callable[[SingleAction, Scene], SingleAction | None]
"""Returns an action as a window shows it; None where it does not."""

_RISE = {"jump": 0.08, "hop": 0.03}
"""Meters by which the pelvis rises in the lowest jump."""

_PUNCH_SPEED = 2.1
"""Meters per second by which a punching fist leaves its shoulder; gestures are slower."""

_OTHER = {LEFT: RIGHT, RIGHT: LEFT}


def _only(action: SingleAction, events: list[Event], count: int | None = None) -> bool:
    """Whether events are all of the action's side, and as many as it has."""
    if not events:
        return False
    if action.side in (LEFT, RIGHT) and any(event.side != action.side for event in events):
        return False
    return count is None or count == action.count


def _times(*kinds: str) -> Check:
    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        events = scene.find(*(kinds or (action.kind,)))
        number = sum(event.count for event in events)
        return action if _only(action, events, number) else None

    return check


def _squats(action: SingleAction, scene: Scene) -> SingleAction | None:
    planted = float(scene.signals.feet.max()) < 0.15
    return action if planted and _only(action, (e := scene.find("squat")), len(e)) else None


def _jumps(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("jump", "hop")
    real = [event for event in events if event.amount >= _RISE[event.kind]]
    if len(real) != action.count or len(events) != len(real):
        return None
    if action.kind == "hop" and not all(_is_hop(event, action.side, scene) for event in events):
        return None
    if action.kind == "jump" and any(e.kind == "hop" for e in events):
        return None
    way = max(meters(scene).items(), key=lambda item: item[1])
    far = way[1] > (0.3 if way[0] == "forward" else 0.2)
    near = scene.facts.path.length < 0.4
    if not far and not near:
        return None
    return replace(action, direction=way[0] if far else "")


def _is_hop(event: Event, side: str, scene: Scene) -> bool:
    """Whether it is a hop on that foot, and the other foot does not touch the floor around it."""
    around = slice(max(event.start - 3, 0), event.end + 4)
    other = scene.signals.feet[around, 1 if side == LEFT else 0]
    return event.kind == "hop" and event.side == side and float(other.min()) > 0.05


def _kicks(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("kick")
    if not _only(action, events, len(events)) or any(e.kind == "hop" for e in scene.find("hop")):
        return None
    ways = {event.direction for event in events}
    return replace(action, direction=ways.pop() if len(ways) == 1 else "")


def _punches(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("punch")
    if len(events) != action.count or scene.find("wave"):
        return None
    sides = {event.side for event in events}
    right = sides == {action.side} or (action.side == BOTH and len(sides) == 2)
    quick = all(event.amount > _PUNCH_SPEED for event in events)
    return action if right and quick else None


def _waves(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("wave")
    others_down = all(
        highest_hand(scene, side) < 0.05
        for side in (LEFT, RIGHT)
        if action.side not in (side, BOTH)
    )
    calm = np.degrees(np.ptp(scene.signals.heading)) < 50
    right = {event.side for event in events} == {action.side}
    return action if right and others_down and calm else None


def _raises(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("raise")
    if scene.find("wave", "punch", "clap", "arm_circle") or len(events) != action.count:
        return None
    if any(event.side != action.side or event.amount < 0.12 for event in events):
        return None
    other = [s for s in (LEFT, RIGHT) if s != action.side and action.side != BOTH]
    if any(highest_hand(scene, side) > -0.15 for side in other):
        return None
    up = {event.direction for event in events}
    return replace(action, direction=up.pop() if len(up) == 1 else "")


def _knees(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("knee")
    if scene.find("kick", "hop", "jump") or len(events) != action.count:
        return None
    sides = {event.side for event in events}
    if action.side == BOTH:
        return action if len(sides) == 2 else None
    return action if sides == {action.side} else None


def _marches(action: SingleAction, scene: Scene) -> SingleAction | None:
    if not in_place(scene, 0.6):
        return None
    lifts = [len(peaks(foot, 0.05, 0.05)) for foot in scene.signals.feet.T]
    return action if min(lifts) >= 2 and sum(lifts) >= 4 else None


def _reaches(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("pick_up")
    ends = scene.facts.postures[-1].kind, scene.facts.postures[0].kind
    fine = len(events) == 1 and ends == ("stand", "stand")
    return replace(action, side=events[0].side) if fine else None


def _held(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find(action.kind)
    held = sum(event.frames for event in events) > 0.4 * scene.facts.frames
    if action.kind == "touch_head" and highest_hand(scene, _OTHER[action.side]) > -0.1:
        return None
    if action.kind == "hands_on_hips" and not _rests_hands(scene):
        return None
    return action if held and _only(action, events) else None


def _rests_hands(scene: Scene) -> bool:
    """Whether both hands are at the sides of the waist, elbows out, and not before the belly."""
    there = np.ones(scene.facts.frames, bool)
    for side, sign in ((LEFT, 1), (RIGHT, -1)):
        wrist, elbow = scene.signals.of(f"{side}_wrist"), scene.signals.of(f"{side}_elbow")
        high = wrist[:, 1] - scene.signals.joints[:, 0, 1]
        there &= (sign * wrist[:, 0] > 0.13) & (sign * (elbow - wrist)[:, 0] > 0.05)
        there &= (wrist[:, 2] < 0.17) & (high > -0.05) & (high < 0.3)
    return float(there.mean()) > 0.5


def _circles(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("arm_circle")
    fine = events and {event.side for event in events} == {action.side}
    count = sum(event.count for event in events)
    return replace(action, direction=events[0].direction, count=count) if fine else None


ACT_CHECKS: dict[str, Check] = {
    "jump": _jumps, "hop": _jumps, "kick": _kicks, "punch": _punches, "wave": _waves,
    "raise": _raises, "clap": _times(), "knee": _knees, "march": _marches,
    "jog_in_place": _marches, "jack": _times(), "squat": _squats, "bow": _times(),
    "pick_up": _reaches, "balance": _held, "arms_out": _held, "hands_on_hips": _held,
    "touch_head": _held, "arm_circle": _circles,
}  # fmt: skip
"""Checks by kind."""
